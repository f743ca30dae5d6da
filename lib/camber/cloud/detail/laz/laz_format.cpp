#include "camber/cloud/detail/laz/laz_format.h"

#include <algorithm>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/arithmetic_decoder.h"
#include "camber/cloud/detail/laz/arithmetic_encoder.h"

namespace camber::laz {
namespace {

constexpr std::size_t kRecordHead = 34, kItemSize = 6;
constexpr std::size_t kTableHead = 8, kOffsetSize = 8;
constexpr std::size_t kPointLayers = 9;

template <typename T>
T load(const std::string& bytes, std::size_t at) {
  return detail::load<T>(reinterpret_cast<const unsigned char*>(bytes.data()) + at);
}

const char* name_of(std::uint16_t type) {
  switch (type) {
    case LazItem::kBytes:
      return "bytes";
    case LazItem::kPoint10:
      return "point 10";
    case LazItem::kTime:
      return "time";
    case LazItem::kColor:
      return "colour";
    case LazItem::kWavePacket:
      return "wave packet";
    case LazItem::kPoint14:
      return "point 14";
    case LazItem::kColor14:
      return "colour 14";
    case LazItem::kColorInfrared14:
      return "colour and near infrared 14";
    case LazItem::kWavePacket14:
      return "wave packet 14";
    case LazItem::kBytes14:
      return "bytes 14";
    default:
      return "unknown";
  }
}

class LayoutReader {
 public:
  LayoutReader(LasFile* las, const LasRecord& record, bool lenient, std::vector<std::string>* notes)
      : las_(*las), file_(*las->bytes), record_(record), lenient_(lenient), notes_(notes) {}

  void read() {
    read_record();
    check_items();
    layout_.data_start = las_.points_start;
    layout_.data_end = file_.size();
    las_.tail_end = file_.size();
    if (layout_.compressor == Compressor::kOneStream) {
      layout_.sequential = true;
    } else {
      layout_.data_start += kOffsetSize;
      find_chunks();
    }
    if (layout_.sequential) las_.points = las_.declared_count;
    las_.points_end = layout_.data_end;
    las_.laz = std::make_shared<const LazLayout>(std::move(layout_));
  }

 private:
  void read_record();
  void check_items();
  void find_chunks();
  bool read_table();
  bool read_chunk_sizes(std::uint64_t table, std::uint32_t count);
  void set_points_of_chunks();
  void scan_layers();
  bool scan_chunk(std::uint64_t at, LazChunk* chunk) const;
  std::uint64_t extended_records_start() const;
  [[noreturn]] void fail(std::size_t at, const std::string& reason) const {
    file_.fail_at(record_.content + at, reason);
  }

  LasFile& las_;
  const FileBytes& file_;
  const LasRecord& record_;
  bool lenient_;
  std::vector<std::string>* notes_;
  LazLayout layout_;
  std::string no_table_;  // why
};

void LayoutReader::read_record() {
  const std::string bytes =
      file_.read(record_.content, std::min<std::uint64_t>(record_.length, 65535));
  if (bytes.size() < kRecordHead) {
    fail(0, "found a LASzip record of " + std::to_string(bytes.size()) +
                " bytes, expected at least " + std::to_string(kRecordHead));
  }
  const auto compressor = load<std::uint16_t>(bytes, 0);
  if (compressor < 1 || compressor > 3) {
    fail(0, "found the LASzip compressor " + std::to_string(compressor) + ", expected 1, 2 or 3");
  }
  layout_.compressor = static_cast<Compressor>(compressor);
  const auto coder = load<std::uint16_t>(bytes, 2);
  if (coder != 0) {
    fail(2, "found the LASzip coder " + std::to_string(coder) + ", expected 0 (arithmetic)");
  }
  layout_.version = std::to_string(static_cast<unsigned char>(bytes[4])) + "." +
                    std::to_string(static_cast<unsigned char>(bytes[5]));
  layout_.chunk_size = load<std::uint32_t>(bytes, 12);
  // LAStools write 0 for the chunks of COPC files.
  if (layout_.chunk_size == 0) layout_.chunk_size = kVariableChunks;
  const std::size_t count = load<std::uint16_t>(bytes, 32);
  if (count == 0 || count > (bytes.size() - kRecordHead) / kItemSize) {
    fail(32, "found a LASzip record of " + std::to_string(bytes.size()) + " bytes with " +
                 std::to_string(count) + " items, expected at least one, and room for all");
  }
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = kRecordHead + i * kItemSize;
    LazItem item;
    item.type = load<std::uint16_t>(bytes, at);
    item.size = load<std::uint16_t>(bytes, at + 2);
    item.version = load<std::uint16_t>(bytes, at + 4);
    layout_.items.push_back(item);
  }
}

/// They follow from the point format and the record's length.
void LayoutReader::check_items() {
  const std::vector<LazItem> expected = items_of(las_.point_format, las_.extra_length());
  const bool layers = layout_.compressor == Compressor::kLayers;
  if (layers != (las_.point_format >= 6)) {
    fail(0, "found the LASzip compressor " + std::to_string(static_cast<int>(layout_.compressor)) +
                " with point format " + std::to_string(las_.point_format) + ", expected " +
                (layers ? "1 or 2" : "3"));
  }
  for (std::size_t i = 0; i < layout_.items.size(); ++i) {
    const LazItem& item = layout_.items[i];
    const std::size_t at = kRecordHead + i * kItemSize;
    if (i >= expected.size() || item.type != expected[i].type || item.size != expected[i].size) {
      const std::string wanted = i >= expected.size()
                                     ? "none"
                                     : "type " + std::to_string(expected[i].type) + " (" +
                                           name_of(expected[i].type) + ") of " +
                                           std::to_string(expected[i].size) + " bytes";
      fail(at, "found LASzip item " + std::to_string(i + 1) + " of type " +
                   std::to_string(item.type) + " (" + name_of(item.type) + ") with " +
                   std::to_string(item.size) + " bytes, expected " + wanted + " in records of " +
                   std::to_string(las_.record_length) + " bytes of point format " +
                   std::to_string(las_.point_format));
    }
    const bool known =
        layers ? item.version == 3 || item.version == 4 : item.version == 1 || item.version == 2;
    if (!known) {
      fail(at + 4, "found version " + std::to_string(item.version) + " of LASzip item " +
                       std::to_string(i + 1) + " (" + name_of(item.type) + "), expected " +
                       (layers ? "3 or 4" : "1 or 2"));
    }
  }
  if (layout_.items.size() < expected.size()) {
    fail(32, "found " + std::to_string(layout_.items.size()) + " LASzip items, expected " +
                 std::to_string(expected.size()) + " in records of " +
                 std::to_string(las_.record_length) + " bytes of point format " +
                 std::to_string(las_.point_format));
  }
}

std::uint64_t LayoutReader::extended_records_start() const {
  const std::size_t place = las_.minor >= 4 ? 235 : 227;
  if (las_.minor < 3) return file_.size();
  const auto start = load<std::uint64_t>(file_.read(place, 8), 0);
  return start > layout_.data_start && start < file_.size() ? start : file_.size();
}

void LayoutReader::find_chunks() {
  const bool table = read_table();
  if (!table) {
    layout_.chunks.clear();
    layout_.data_end = std::max(std::min(extended_records_start(), file_.size()),
                                std::min(layout_.data_start, file_.size()));
    if (las_.declared_count > 0) {
      notes_->push_back("the table of chunks cannot be used (" + no_table_ +
                        "): the points are found chunk by chunk");
      if (layout_.compressor == Compressor::kLayers) {
        scan_layers();
      } else if (layout_.chunk_size == kVariableChunks) {
        file_.fail_at(las_.points_start, "found no table of chunks that can be used (" + no_table_ +
                                             "), expected one: the chunks differ in size");
      } else {
        layout_.sequential = true;
      }
    }
  }
  if (!layout_.sequential) set_points_of_chunks();
}

/// The chunks by their table; what they hold is not checked yet.
bool LayoutReader::read_table() {
  const auto none = [&](const std::string& why) {
    no_table_ = why;
    return false;
  };
  if (file_.size() - las_.points_start < kOffsetSize) return none("the file ends before it");
  auto table = load<std::uint64_t>(file_.read(las_.points_start, kOffsetSize), 0);
  const auto possible = [&](std::uint64_t at) {
    return at >= layout_.data_start && at <= file_.size() - kTableHead;
  };
  if (file_.size() < layout_.data_start + kTableHead) return none("the file ends before it");
  // A writer to a stream leaves the place behind everything.
  if (table == UINT64_MAX || table <= las_.points_start) {
    const auto at_end = load<std::uint64_t>(file_.read(file_.size() - kOffsetSize, kOffsetSize), 0);
    if (!possible(at_end)) return none("it was never written");
    table = at_end;
    las_.tail_end = file_.size() - kOffsetSize;
  }
  if (!possible(table)) {
    return none("it is at byte " + std::to_string(table) + " of " + std::to_string(file_.size()));
  }
  const std::string head = file_.read(table, kTableHead);
  if (load<std::uint32_t>(head, 0) != 0) return none("its version is not 0");
  const auto count = load<std::uint32_t>(head, 4);
  // Each chunk begins with a whole record.
  const std::uint64_t most = (table - layout_.data_start) / las_.record_length;
  if (count > most) {
    return none(std::to_string(count) + " chunks, of which the file has room for " +
                std::to_string(most));
  }
  if (!read_chunk_sizes(table, count)) return false;
  return true;
}

bool LayoutReader::read_chunk_sizes(std::uint64_t table, std::uint32_t count) {
  const std::uint64_t start = table + kTableHead;
  // What a number takes at the most: its width, eight bits by a model, the others as they are.
  constexpr std::uint64_t kMostBytes = 16;
  const std::string bytes =
      count == 0 ? std::string()
                 : file_.read(start, std::min<std::uint64_t>(file_.size() - start,
                                                             kMostBytes * (count + 1)));
  const auto* const begin = reinterpret_cast<const unsigned char*>(bytes.data());
  ArithmeticDecoder decoder(begin, begin + bytes.size());
  if (count > 0) decoder.start();
  IntegerModel model(32, 2);
  const bool variable = layout_.chunk_size == kVariableChunks;
  std::uint64_t at = layout_.data_start;
  std::int32_t points = 0, size = 0;
  layout_.chunks.reserve(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (variable) points = model.code(decoder, points, 0, 0);
    size = model.code(decoder, size, 1, 0);
    LazChunk chunk;
    chunk.start = at;
    chunk.size = static_cast<std::uint32_t>(size);
    chunk.points = variable ? static_cast<std::uint32_t>(points) : layout_.chunk_size;
    if (decoder.exhausted() || chunk.size < las_.record_length || chunk.size > table - at ||
        chunk.points == 0) {
      no_table_ =
          "it is damaged at chunk " + std::to_string(i + 1) + " of " + std::to_string(count);
      return false;
    }
    at += chunk.size;
    layout_.chunks.push_back(chunk);
  }
  if (at != table) {
    no_table_ = "its sizes end at byte " + std::to_string(at) + ", the chunks at byte " +
                std::to_string(table);
    return false;
  }
  layout_.data_end = start + static_cast<std::uint64_t>(
                                 decoder.position() == nullptr ? 0 : decoder.position() - begin);
  return true;
}

/// Each chunk of layers has its number of points and bytes in its head.
bool LayoutReader::scan_chunk(std::uint64_t at, LazChunk* chunk) const {
  const std::uint64_t head = las_.record_length + 4 + 4 * layout_.layers();
  if (at > layout_.data_end || layout_.data_end - at < head) return false;
  const std::string sizes = file_.read(at + las_.record_length, 4 + 4 * layout_.layers());
  chunk->start = at;
  chunk->size = head;
  chunk->points = load<std::uint32_t>(sizes, 0);
  for (std::size_t i = 0; i < layout_.layers(); ++i) {
    chunk->size += load<std::uint32_t>(sizes, 4 + 4 * i);
  }
  return chunk->points > 0 && chunk->size <= layout_.data_end - at;
}

void LayoutReader::scan_layers() {
  std::uint64_t at = layout_.data_start, points = 0;
  LazChunk chunk;
  while (points < las_.declared_count && scan_chunk(at, &chunk)) {
    layout_.chunks.push_back(chunk);
    at += chunk.size;
    points += chunk.points;
  }
  // The table, or what is left of it, is no part of what stands behind the points.
  if (points < las_.declared_count && !lenient_) {
    file_.fail_at(at, "found no whole chunk behind " + std::to_string(points) + " points in " +
                          std::to_string(layout_.chunks.size()) + " chunks, expected " +
                          std::to_string(las_.declared_count) + " points");
  }
}

/// Checks the number of points; the last of several chunks of one size has the rest.
void LayoutReader::set_points_of_chunks() {
  std::vector<LazChunk>& chunks = layout_.chunks;
  const bool fixed = layout_.chunk_size != kVariableChunks;
  std::uint64_t room = 0;
  for (const LazChunk& chunk : chunks) room += chunk.points;
  std::uint64_t least = fixed && !chunks.empty() ? room - chunks.back().points + 1 : room;
  std::uint64_t declared = las_.declared_count;
  if (declared > room && lenient_) {
    // The points of the last chunk are counted in its head, or by return.
    if (layout_.compressor == Compressor::kLayers && !chunks.empty()) {
      LazChunk last;
      if (scan_chunk(chunks.back().start, &last) && last.points <= chunks.back().points) {
        declared = room - chunks.back().points + last.points;
      }
    } else if (fixed) {
      std::uint64_t by_return = 0;
      for (const std::uint64_t count : las_.points_by_return) by_return += count;
      if (by_return >= least && by_return <= room) declared = by_return;
    }
    if (declared > room && !fixed) declared = room;
  }
  if (declared < least || declared > room) {
    file_.fail_at(las_.minor >= 4 && las_.point_format >= 6 ? 247 : 107,
                  "found " + std::to_string(las_.declared_count) + " points, expected " +
                      (least == room ? std::to_string(room)
                                     : std::to_string(least) + " to " + std::to_string(room)) +
                      " in " + std::to_string(chunks.size()) + " chunks");
  }
  if (fixed && !chunks.empty()) chunks.back().points -= room - declared;
  las_.points = declared;
}

}  // namespace

std::size_t LazItem::layers() const {
  switch (type) {
    case kPoint14:
      return kPointLayers;
    case kColorInfrared14:
      return 2;
    case kBytes14:
      return size;
    default:
      return 1;
  }
}

std::size_t LazLayout::layers() const {
  std::size_t layers = 0;
  for (const LazItem& item : items) layers += item.layers();
  return layers;
}

std::vector<LazItem> items_of(int point_format, std::size_t extra_bytes) {
  const detail::LasPointFormat format = detail::las_point_format(point_format);
  std::vector<LazItem> items;
  const auto add = [&](LazItem::Type type, std::size_t size, int version) {
    items.push_back({type, static_cast<std::uint16_t>(size), static_cast<std::uint16_t>(version)});
  };
  if (format.extended) {
    add(LazItem::kPoint14, 30, 3);
    if (format.infrared >= 0) {
      add(LazItem::kColorInfrared14, 8, 3);
    } else if (format.color >= 0) {
      add(LazItem::kColor14, 6, 3);
    }
    if (format.wave >= 0) add(LazItem::kWavePacket14, 29, 3);
    if (extra_bytes > 0) add(LazItem::kBytes14, extra_bytes, 3);
    return items;
  }
  add(LazItem::kPoint10, 20, 2);
  if (format.time >= 0) add(LazItem::kTime, 8, 2);
  if (format.color >= 0) add(LazItem::kColor, 6, 2);
  if (format.wave >= 0) add(LazItem::kWavePacket, 29, 1);
  if (extra_bytes > 0) add(LazItem::kBytes, extra_bytes, 2);
  return items;
}

void read_layout(LasFile* las, const LasRecord& record, bool lenient,
                 std::vector<std::string>* notes) {
  LayoutReader(las, record, lenient, notes).read();
}

std::string layout_record(const LazLayout& layout) {
  // The version that a reader must know: 3.4 has items of all versions that are written.
  constexpr unsigned char kMajor = 3, kMinor = 4;
  std::string out(kRecordHead, '\0');
  detail::store(out, 0, static_cast<std::uint16_t>(layout.compressor));
  out[4] = static_cast<char>(kMajor);
  out[5] = static_cast<char>(kMinor);
  detail::store(out, 12, layout.chunk_size);
  detail::store(out, 16, std::int64_t{-1});
  detail::store(out, 24, std::int64_t{-1});
  detail::store(out, 32, static_cast<std::uint16_t>(layout.items.size()));
  for (const LazItem& item : layout.items) {
    const std::size_t at = out.size();
    out.resize(at + kItemSize);
    detail::store(out, at, item.type);
    detail::store(out, at + 2, item.size);
    detail::store(out, at + 4, item.version);
  }
  return out;
}

std::string chunk_table(const LazLayout& layout) {
  std::string out(kTableHead, '\0');
  detail::store(out, 4, static_cast<std::uint32_t>(layout.chunks.size()));
  if (layout.chunks.empty()) return out;
  ArithmeticEncoder encoder;
  IntegerModel model(32, 2);
  std::int32_t points = 0, size = 0;
  for (const LazChunk& chunk : layout.chunks) {
    if (layout.chunk_size == kVariableChunks) {
      points = model.code(encoder, points, 0, static_cast<std::int32_t>(chunk.points));
    }
    size = model.code(encoder, size, 1, static_cast<std::int32_t>(chunk.size));
  }
  return out + encoder.finish();
}

}  // namespace camber::laz
