#include "camber/export/mcap_file.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>

#include "camber/core/errors.h"
#include "camber/core/version.h"

namespace camber {
namespace {

constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};
constexpr unsigned char kHeader = 1, kFooter = 2, kSchema = 3, kChannel = 4, kMessage = 5,
                        kChunk = 6, kMessageIndex = 7, kChunkIndex = 8, kStatistics = 11,
                        kSummaryOffset = 14, kDataEnd = 15;
constexpr int kLevel = 3;  // of zstd

template <typename T>
void add(std::string& out, T value) {
  for (std::size_t k = 0; k < sizeof(T); ++k) {
    out += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * k));
  }
}

void add_text(std::string& out, std::string_view text) {
  add(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}

std::string record(unsigned char kind, std::string_view content) {
  std::string out(1, static_cast<char>(kind));
  add(out, static_cast<std::uint64_t>(content.size()));
  out += content;
  return out;
}

std::uint32_t crc_of(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

std::string compressed(std::string_view bytes) {
  std::string out(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size =
      ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), kLevel);
  if (ZSTD_isError(size) != 0) throw MachineError("zstd cannot compress a chunk of MCAP");
  out.resize(size);
  return out;
}

}  // namespace

McapWriter::McapWriter(std::ostream& out, std::size_t chunk_size)
    : out_(out), chunk_size_(chunk_size) {
  std::string header;
  add_text(header, "");
  add_text(header, std::string("camber ") + kVersion);
  put(std::string(kMagic) + record(kHeader, header));
}

void McapWriter::put(const std::string& bytes) {
  out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  place_ += bytes.size();
}

std::uint16_t McapWriter::add_schema(const std::string& name, const std::string& json_schema) {
  const auto id = static_cast<std::uint16_t>(schemas_.size() + 1);
  std::string content;
  add(content, id);
  add_text(content, name);
  add_text(content, "jsonschema");
  add_text(content, json_schema);
  schemas_.push_back(record(kSchema, content));
  records_ += schemas_.back();
  return id;
}

std::uint16_t McapWriter::add_channel(std::uint16_t schema, const std::string& topic) {
  const auto id = static_cast<std::uint16_t>(channels_.size() + 1);
  std::string content;
  add(content, id);
  add(content, schema);
  add_text(content, topic);
  add_text(content, "json");
  add(content, std::uint32_t{0});  // no metadata
  channels_.push_back(record(kChannel, content));
  records_ += channels_.back();
  return id;
}

void McapWriter::write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) {
  if (index_.empty()) first_ = last_ = time_ns;
  first_ = std::min(first_, time_ns);
  last_ = std::max(last_, time_ns);
  std::string& index = index_[channel];
  add(index, time_ns);
  add(index, static_cast<std::uint64_t>(records_.size()));
  std::string content;
  content.reserve(message.size() + 22);
  add(content, channel);
  add(content, sequences_[channel]++);
  add(content, time_ns);
  add(content, time_ns);
  content += message;
  records_ += record(kMessage, content);
  ++counts_[channel];
  if (records_.size() >= chunk_size_) end_chunk();
}

void McapWriter::end_chunk() {
  if (records_.empty()) return;
  Chunk chunk;
  chunk.first = first_;
  chunk.last = last_;
  chunk.start = place_;
  chunk.uncompressed = records_.size();
  const std::string data = compressed(records_);
  chunk.compressed = data.size();
  std::string content;
  add(content, chunk.first);
  add(content, chunk.last);
  add(content, chunk.uncompressed);
  add(content, crc_of(records_));
  add_text(content, "zstd");
  add(content, chunk.compressed);
  content += data;
  put(record(kChunk, content));
  chunk.length = place_ - chunk.start;
  const std::uint64_t index_start = place_;
  for (const auto& [channel, entries] : index_) {
    chunk.index[channel] = place_;
    std::string index;
    add(index, channel);
    add_text(index, entries);
    put(record(kMessageIndex, index));
  }
  chunk.index_length = place_ - index_start;
  chunks_.push_back(std::move(chunk));
  records_.clear();
  index_.clear();
  first_ = last_ = 0;
}

void McapWriter::finish() {
  end_chunk();
  std::string end;
  add(end, std::uint32_t{0});  // no checksum of the data beside those of the chunks
  put(record(kDataEnd, end));
  const std::uint64_t summary_start = place_;
  std::string summary, offsets;
  const auto group = [&](unsigned char kind, const std::vector<std::string>& records) {
    if (records.empty()) return;
    const std::uint64_t start = summary_start + summary.size();
    for (const std::string& one : records) summary += one;
    std::string offset(1, static_cast<char>(kind));
    add(offset, start);
    add(offset, summary_start + summary.size() - start);
    offsets += record(kSummaryOffset, offset);
  };
  group(kSchema, schemas_);
  group(kChannel, channels_);
  std::string statistics;
  std::uint64_t messages = 0, first = 0, last = 0;
  for (const auto& [channel, count] : counts_) messages += count;
  for (std::size_t i = 0; i < chunks_.size(); ++i) {
    first = i == 0 ? chunks_[i].first : std::min(first, chunks_[i].first);
    last = std::max(last, chunks_[i].last);
  }
  add(statistics, messages);
  add(statistics, static_cast<std::uint16_t>(schemas_.size()));
  add(statistics, static_cast<std::uint32_t>(channels_.size()));
  add(statistics, std::uint32_t{0});  // attachments
  add(statistics, std::uint32_t{0});  // metadata
  add(statistics, static_cast<std::uint32_t>(chunks_.size()));
  add(statistics, first);
  add(statistics, last);
  std::string counts;
  for (const auto& [channel, count] : counts_) {
    add(counts, channel);
    add(counts, count);
  }
  add_text(statistics, counts);
  group(kStatistics, {record(kStatistics, statistics)});
  std::vector<std::string> indices;
  for (const Chunk& chunk : chunks_) {
    std::string content, places;
    add(content, chunk.first);
    add(content, chunk.last);
    add(content, chunk.start);
    add(content, chunk.length);
    for (const auto& [channel, place] : chunk.index) {
      add(places, channel);
      add(places, place);
    }
    add_text(content, places);
    add(content, chunk.index_length);
    add_text(content, "zstd");
    add(content, chunk.compressed);
    add(content, chunk.uncompressed);
    indices.push_back(record(kChunkIndex, content));
  }
  group(kChunkIndex, indices);
  const std::uint64_t offsets_start = summary_start + summary.size();
  // The checksum is over the summary and what of the footer is before it.
  std::string footer(1, static_cast<char>(kFooter));
  add(footer, std::uint64_t{20});
  add(footer, summary_start);
  add(footer, offsets_start);
  std::string tail = summary + offsets + footer;
  add(tail, crc_of(tail));
  put(tail + std::string(kMagic));
}

}  // namespace camber
