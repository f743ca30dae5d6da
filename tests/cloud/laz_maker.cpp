#include "cloud/laz_maker.h"

#include <algorithm>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/arithmetic_encoder.h"
#include "camber/cloud/detail/laz/chunk_codec.h"
#include "camber/cloud/detail/laz/laz_format.h"
#include "camber/core/random.h"

namespace camber::test {
namespace {

using detail::las_record;
using detail::store;

/// The place of a chunk's points: below the root, one child after the other.
std::array<std::int32_t, 4> node_of(std::size_t chunk) {
  if (chunk == 0) return {0, 0, 0, 0};
  const auto child = static_cast<std::int32_t>(chunk - 1);
  return {1, child & 1, child >> 1 & 1, child >> 2 & 1};
}

std::string make_records(const MadeLaz& what, std::size_t size) {
  const CounterRandom random(static_cast<std::uint64_t>(what.point_format), what.chunks.size());
  std::string out;
  std::uint64_t draw = 0;
  std::string record(size, '\0');
  for (std::size_t chunk = 0; chunk < what.chunks.size(); ++chunk) {
    const std::array<std::int32_t, 4> node = node_of(chunk);
    const double cell = 100.0 / (1 << node[0]);
    for (std::size_t i = 0; i < what.chunks[chunk]; ++i) {
      for (std::size_t at = 12; at < size; ++at) {
        if (random.uniform(draw++) < 0.1) record[at] = static_cast<char>(random.bits(draw++));
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x = cell * (node[axis + 1] + random.uniform(draw++));
        store(record, 4 * axis, static_cast<std::int32_t>(1000.0 * x));
      }
      out += record;
    }
  }
  return out;
}

std::string entry(const std::array<std::int32_t, 4>& node, std::uint64_t start, std::uint64_t size,
                  std::int32_t points) {
  std::string out(32, '\0');
  for (std::size_t k = 0; k < 4; ++k) store(out, 4 * k, node[k]);
  store(out, 16, start);
  store(out, 24, static_cast<std::int32_t>(size));
  store(out, 28, points);
  return out;
}

/// The content of the record with the index, which stands at a place of the file.
std::string index_pages(const laz::LazLayout& layout, std::uint64_t place) {
  std::string root, second;
  for (std::size_t i = 0; i < layout.chunks.size(); ++i) {
    const laz::LazChunk& chunk = layout.chunks[i];
    (i < 2 ? root : second) +=
        entry(node_of(i), chunk.start, chunk.size, static_cast<std::int32_t>(chunk.points));
  }
  if (!second.empty()) {
    root += entry(node_of(2), place + root.size() + 32, second.size(), -1);
  }
  return root + second;
}

}  // namespace

std::string make_laz(const MadeLaz& what, std::string* records) {
  const detail::LasPointFormat format = detail::las_point_format(what.point_format);
  const std::size_t size = format.size + what.extra_bytes;
  laz::LazLayout layout;
  layout.compressor = static_cast<laz::Compressor>(what.compressor);
  layout.chunk_size = what.compressor == 1         ? 0
                      : what.variable || what.copc ? laz::kVariableChunks
                                                   : static_cast<std::uint32_t>(what.chunks.at(0));
  layout.items = laz::items_of(what.point_format, what.extra_bytes);
  for (laz::LazItem& item : layout.items) {
    if (what.version != 0 && item.type != laz::LazItem::kWavePacket) {
      item.version = static_cast<std::uint16_t>(what.version);
    }
  }
  const std::string points = make_records(what, size);
  if (records != nullptr) *records = points;
  const std::size_t count = points.size() / size;

  std::string header(what.minor >= 4 ? 375 : what.minor == 3 ? 235 : 227, '\0');
  header.replace(0, 4, "LASF");
  header[24] = 1;
  header[25] = static_cast<char>(what.minor);
  store(header, 94, static_cast<std::uint16_t>(header.size()));
  header[104] = static_cast<char>(what.point_format | 0x80);
  store(header, 105, static_cast<std::uint16_t>(size));
  if (!format.extended) store(header, 107, static_cast<std::uint32_t>(count));
  if (what.minor >= 4) store(header, 247, static_cast<std::uint64_t>(count));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    store(header, 131 + 8 * axis, 0.001);
    store(header, 179 + 16 * axis, 100.0);
  }
  std::string info(160, '\0');
  for (std::size_t k = 0; k < 4; ++k) store(info, 8 * k, 50.0);  // centre and half the side
  store(info, 32, 10.0);                                         // spacing
  std::string table_records;
  if (what.copc) table_records += las_record("copc", 1, "COPC info", info);
  table_records += las_record(laz::kRecordUser, laz::kRecordId, "made", laz::layout_record(layout));
  store(header, 96, static_cast<std::uint32_t>(header.size() + table_records.size()));
  store(header, 100, std::uint32_t{what.copc ? 2u : 1u});

  std::string out = header + table_records;
  const std::size_t points_start = out.size();
  if (what.compressor != 1) out.append(8, '\xff');
  std::size_t first = 0;
  const std::vector<std::size_t> chunks =
      what.compressor == 1 ? std::vector<std::size_t>{count} : what.chunks;
  for (const std::size_t chunk_points : chunks) {
    laz::LazChunk chunk;
    chunk.start = out.size();
    chunk.points = chunk_points;
    out += laz::encode_chunk(layout.items,
                             reinterpret_cast<const unsigned char*>(points.data()) + first * size,
                             chunk_points);
    chunk.size = out.size() - chunk.start;
    layout.chunks.push_back(chunk);
    first += chunk_points;
  }
  if (what.compressor == 1) return out;
  const auto table = static_cast<std::int64_t>(out.size());
  if (what.table) {
    if (!what.offset_at_end) store(out, points_start, table);
    out += laz::chunk_table(layout);
  }
  if (what.copc) {
    const std::uint64_t place = out.size() + detail::kLasExtendedHeader;
    const std::string pages = index_pages(layout, place);
    const std::uint64_t root =
        std::min<std::uint64_t>(pages.size(), 32 * std::min<std::size_t>(3, chunks.size()));
    std::string extended(detail::kLasExtendedHeader, '\0');
    extended.replace(2, 4, "copc");
    store(extended, 18, std::uint16_t{1000});
    store(extended, 20, static_cast<std::uint64_t>(pages.size()));
    store(out, 235, static_cast<std::uint64_t>(out.size()));
    store(out, 243, std::uint32_t{1});
    const std::size_t info_at = header.size() + detail::kLasRecordHeader;
    store(out, info_at + 40, place);
    store(out, info_at + 48, root);
    out += extended + pages;
  }
  if (what.offset_at_end) {
    out.append(8, '\0');
    store(out, out.size() - 8, table);
  }
  return out;
}

}  // namespace camber::test
