#include "camber/cloud/detail/laz/laz_writer.h"

#include <algorithm>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/chunk_codec.h"
#include "camber/core/threads.h"

namespace camber::laz {
namespace {

LazLayout make_layout(int point_format, std::size_t record_length) {
  const detail::LasPointFormat format = detail::las_point_format(point_format);
  LazLayout layout;
  layout.compressor = format.extended ? Compressor::kLayers : Compressor::kChunks;
  layout.chunk_size = kUsualChunkSize;
  layout.items = items_of(point_format, record_length - format.size);
  return layout;
}

}  // namespace

LazWriter::LazWriter(std::ostream& out, std::ostream::pos_type file_start, int point_format,
                     std::size_t record_length)
    : out_(out),
      layout_(make_layout(point_format, record_length)),
      record_length_(record_length),
      file_start_(file_start),
      start_(out.tellp()),
      most_chunks_(static_cast<std::size_t>(resolve_num_threads(0))) {
  const std::int64_t table = -1;  // not known yet
  out_.write(reinterpret_cast<const char*>(&table), sizeof table);
}

void LazWriter::write(const char* records, std::size_t count) {
  const std::size_t group = most_chunks_ * layout_.chunk_size;
  while (count > 0) {
    const std::size_t some = std::min(count, group - points_ready());
    const auto* const begin = reinterpret_cast<const unsigned char*>(records);
    records_.insert(records_.end(), begin, begin + some * record_length_);
    records += some * record_length_;
    count -= some;
    if (points_ready() == group) write_chunks(most_chunks_);
  }
}

void LazWriter::write_chunks(std::size_t count) {
  std::vector<std::string> coded(count);
  const std::size_t points = points_ready(), each = layout_.chunk_size;
  parallel_for(count, 0, [&](std::size_t i) {
    const std::size_t first = i * each;
    coded[i] = encode_chunk(layout_.items, records_.data() + first * record_length_,
                            std::min(each, points - first));
  });
  for (std::size_t i = 0; i < count; ++i) {
    out_.write(coded[i].data(), static_cast<std::streamsize>(coded[i].size()));
    LazChunk chunk;
    chunk.size = coded[i].size();
    chunk.points = std::min(each, points - i * each);
    layout_.chunks.push_back(chunk);
  }
  records_.clear();
}

void LazWriter::finish() {
  if (points_ready() > 0) {
    write_chunks((points_ready() + layout_.chunk_size - 1) / layout_.chunk_size);
  }
  const std::ostream::pos_type at = out_.tellp();
  const auto table = static_cast<std::int64_t>(static_cast<std::streamoff>(at - file_start_));
  out_.seekp(start_);
  out_.write(reinterpret_cast<const char*>(&table), sizeof table);
  out_.seekp(at);
  const std::string bytes = chunk_table(layout_);
  out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string writer_record(int point_format, std::size_t record_length) {
  return detail::las_record(kRecordUser, kRecordId, "by Camber, see https://laszip.org",
                            layout_record(make_layout(point_format, record_length)));
}

}  // namespace camber::laz
