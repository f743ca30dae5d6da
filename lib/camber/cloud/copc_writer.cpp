// COPC files: "COPC - Cloud Optimized Point Cloud, 1.0", copc.io.

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/chunk_codec.h"
#include "camber/cloud/detail/laz/copc.h"
#include "camber/cloud/detail/laz/copc_index.h"
#include "camber/cloud/detail/laz/octree_sort.h"
#include "camber/cloud/detail/unnamed_file.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/number_text.h"
#include "camber/core/errors.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

using detail::kLasExtendedHeader;
using detail::kLasRecordHeader;
using detail::las_record;
using detail::store;
using detail::UnnamedFile;

constexpr std::size_t kHeaderSize = 375;
constexpr std::size_t kBlock = std::size_t{1} << 20;  // bytes

/// The points of a LAS file (1.4, formats 6 to 8, as they are) into a COPC file.
class CopcFile {
 public:
  CopcFile(const LasFile& las, std::ostream& out, const std::filesystem::path& beside)
      : las_(las), out_(out), start_(out.tellp()) {
    layout_.compressor = laz::Compressor::kLayers;
    layout_.chunk_size = laz::kVariableChunks;
    layout_.items = laz::items_of(las.point_format, las.extra_length());
    options_.record_length = las.record_length;
    options_.scale = las.scale;
    options_.offset = las.offset;
    options_.beside = beside;
    options_.cube = cube_of(las);
    info_.cube = options_.cube;
  }

  void write() {
    std::uint32_t record_count = 0;
    const std::string records = other_records(&record_count);
    const std::string info_record = las_record(laz::kCopcUser, laz::kCopcInfoId, "COPC info",
                                               std::string(copc_info(info_).size(), '\0'));
    const std::uint64_t points_start = kHeaderSize + info_record.size() + records.size();
    if (points_start > UINT32_MAX) {
      throw std::invalid_argument("the records before the points have more than 4 GB");
    }
    std::string head = las_.bytes->read(0, kHeaderSize);
    write_bytes(head + info_record + records + std::string(8, '\0'));
    write_points();
    const std::uint64_t table = position();
    write_bytes(laz::chunk_table(layout_));
    const std::uint64_t extended_start = position();
    const std::uint32_t extended_count = write_extended_records();
    if (info_.last_time < info_.first_time) info_.first_time = info_.last_time = 0.0;
    store(head, 96, static_cast<std::uint32_t>(points_start));
    store(head, 100, record_count + 1);
    store(head, 104, static_cast<std::uint8_t>(las_.point_format | 0x80));
    store(head, 235, extended_start);
    store(head, 243, extended_count);
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    write_bytes(head + las_record(laz::kCopcUser, laz::kCopcInfoId, "COPC info", copc_info(info_)) +
                records);
    out_.write(reinterpret_cast<const char*>(&table), sizeof table);
    out_.seekp(end);
  }

 private:
  static laz::OctreeCube cube_of(const LasFile& las);
  std::uint64_t position() const {
    return static_cast<std::uint64_t>(static_cast<std::streamoff>(out_.tellp() - start_));
  }
  void write_bytes(const std::string& bytes) {
    out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  std::string other_records(std::uint32_t* count) const;
  void write_points();
  void write_nodes();
  std::uint32_t write_extended_records();

  const LasFile& las_;
  std::ostream& out_;
  std::ostream::pos_type start_;
  laz::LazLayout layout_;
  laz::OctreeOptions options_;
  laz::CopcInfo info_{
      {}, 0, 0, std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  struct Node {
    laz::OctreeKey key;
    std::string records;
  };
  std::vector<Node> waiting_;  // to be coded
  std::size_t waiting_bytes_ = 0;
  std::vector<laz::CopcNode> nodes_;
};

/// Around the points, by the header, which was written from them.
laz::OctreeCube CopcFile::cube_of(const LasFile& las) {
  laz::OctreeCube cube;
  double side = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    side = std::max(side, las.maximum[axis] - las.minimum[axis]);
  }
  if (!std::isfinite(side)) {
    throw std::invalid_argument("the coordinates are not finite, expected those of points");
  }
  if (side == 0.0) side = std::max(std::abs(las.scale[0]), std::numeric_limits<double>::min());
  // From the lowest corner, so that ground lies in the lowest nodes and is not parted by height.
  cube.low = las.minimum;
  cube.side = side;
  return cube;
}

/// Those between COPC's own and the points.
std::string CopcFile::other_records(std::uint32_t* count) const {
  std::string out;
  for (const LasRecord& record : las_.records) {
    if (record.extended) continue;
    out += las_.bytes->read(record.start, kLasRecordHeader + record.length);
    ++*count;
  }
  ++*count;
  return out + las_record(laz::kRecordUser, laz::kRecordId, "by Camber, see https://laszip.org",
                          laz::layout_record(layout_));
}

void CopcFile::write_points() {
  const std::size_t size = las_.record_length;
  constexpr std::size_t kTime = 22;
  laz::OctreeSort sort(options_, [&](const laz::OctreeKey& key, std::string records) {
    for (std::size_t at = 0; at < records.size(); at += size) {
      const double time =
          detail::load<double>(reinterpret_cast<const unsigned char*>(&records[at]) + kTime);
      info_.first_time = std::min(info_.first_time, time);
      info_.last_time = std::max(info_.last_time, time);
    }
    waiting_bytes_ += records.size();
    waiting_.push_back({key, std::move(records)});
    constexpr std::size_t kMostWaiting = std::size_t{32} << 20;  // bytes
    if (waiting_bytes_ > kMostWaiting) write_nodes();
  });
  sort.sort(las_.points, [&](const auto& use) {
    const std::uint64_t most = std::max<std::uint64_t>(1, kBlock / size);
    for (std::uint64_t done = 0; done < las_.points;) {
      const std::uint64_t some = std::min(most, las_.points - done);
      const std::string records = las_.bytes->read(las_.points_start + done * size, some * size);
      use(records.data(), static_cast<std::size_t>(some));
      done += some;
    }
  });
  write_nodes();
}

void CopcFile::write_nodes() {
  std::vector<std::string> coded(waiting_.size());
  const auto count = [&](std::size_t i) { return waiting_[i].records.size() / las_.record_length; };
  parallel_for(waiting_.size(), 0, [&](std::size_t i) {
    const std::string& records = waiting_[i].records;
    coded[i] = laz::encode_chunk(layout_.items,
                                 reinterpret_cast<const unsigned char*>(records.data()), count(i));
  });
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    laz::LazChunk chunk;
    chunk.start = position();
    chunk.size = coded[i].size();
    chunk.points = count(i);
    write_bytes(coded[i]);
    layout_.chunks.push_back(chunk);
    nodes_.push_back({waiting_[i].key, chunk});
  }
  waiting_.clear();
  waiting_bytes_ = 0;
}

/// The index, then those that the points' file has. @return how many
std::uint32_t CopcFile::write_extended_records() {
  const std::uint64_t place = position() + kLasExtendedHeader;
  const laz::CopcIndex index = laz::make_copc_index(nodes_, place);
  info_.root_start = place;
  info_.root_size = index.root_size;
  std::string header(kLasExtendedHeader, '\0');
  const std::string user = laz::kCopcUser, description = "COPC index";
  store(header, 2, user.data(), user.size());
  store(header, 18, static_cast<std::uint16_t>(laz::kCopcIndexId));
  store(header, 20, static_cast<std::uint64_t>(index.pages.size()));
  store(header, 28, description.data(), description.size());
  write_bytes(header + index.pages);
  std::uint32_t count = 1;
  for (const LasRecord& record : las_.records) {
    if (!record.extended) continue;
    const std::uint64_t end = record.content + record.length;
    for (std::uint64_t at = record.start; at < end;) {
      const std::string part = las_.bytes->read(at, std::min<std::uint64_t>(kBlock, end - at));
      write_bytes(part);
      at += part.size();
    }
    ++count;
  }
  return count;
}

/// Collects the points in a LAS file without a name, which is sorted at the end.
class CopcSink : public PointSink {
 public:
  CopcSink(std::ostream& out, const PointStreamHeader& header, const std::filesystem::path& beside)
      : out_(out), beside_(beside) {
    require_space(header);
    file_ = std::make_unique<UnnamedFile>(beside, &stream_);
    points_ = header.records ? make_las_copy_sink(stream_, header, LasPoints::kExtended)
                             : make_las_sink(stream_, header, LasPoints::kExtended);
  }

  void write(const PointBatch& batch) override {
    errno = 0;
    points_->write(batch);
    if (!stream_) file_->fail("writing failed");
  }

  void finish() override {
    errno = 0;
    points_->finish();
    stream_.flush();
    if (stream_) stream_.close();
    if (!stream_) file_->fail("writing failed");
    const std::uint64_t size = file_->size();
    const auto bytes = std::make_shared<FileBytes>(file_->release(), size, file_->name());
    std::vector<std::string> notes;
    CopcFile(read_las_file(bytes, true, &notes), out_, beside_).write();
  }

  std::vector<std::string> notes() const override { return points_->notes(); }

 private:
  /// The points as they are, once more while they are sorted where memory does not hold them, and
  /// compressed.
  void require_space(const PointStreamHeader& header) const {
    constexpr double kRecord = 38.0, kCompressed = 0.4;
    double bytes = static_cast<double>(header.count.value_or(0)) *
                   std::max(kRecord, header.las ? 10.0 + header.las->record_length : 0.0);
    bytes *= bytes > static_cast<double>(laz::OctreeOptions().memory) ? 2.0 + kCompressed
                                                                      : 1.0 + kCompressed;
    std::error_code error;
    const std::filesystem::space_info space =
        std::filesystem::space(UnnamedFile::folder_of(beside_), error);
    if (error || static_cast<double>(space.available) >= bytes) return;
    const auto gigabytes = [](double b) {
      std::string text;
      append_number(text, std::round(1e-7 * b) / 100.0);
      return text + " GB";
    };
    throw OutputError(beside_.string(), gigabytes(static_cast<double>(space.available)) +
                                            " are free on the disk, expected " + gigabytes(bytes) +
                                            " for the points and for sorting them");
  }

  std::ostream& out_;
  std::filesystem::path beside_;
  std::ofstream stream_;
  std::unique_ptr<UnnamedFile> file_;
  std::unique_ptr<PointSink> points_;
};

}  // namespace

std::unique_ptr<PointSink> make_copc_sink(std::ostream& out, const PointStreamHeader& header,
                                          const std::filesystem::path& beside) {
  return std::make_unique<CopcSink>(out, header, beside);
}

}  // namespace camber
