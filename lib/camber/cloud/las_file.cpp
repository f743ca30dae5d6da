// Headers and variable-length records of LAS files: the ASPRS specifications ("LAS Specification
// 1.4 - R15", 2019, its predecessors, and 1.5).

#include "camber/cloud/las_file.h"

#include <algorithm>
#include <cmath>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/laz_format.h"
#include "camber/core/errors.h"

namespace camber {
namespace {

using detail::kLasExtendedHeader;
using detail::kLasExtraDescription;
using detail::kLasRecordHeader;

constexpr std::uint64_t kMostCrsBytes = 1 << 20;
constexpr std::uint64_t kMostDescriptions = std::uint64_t{kLasExtraDescription} << 14;

template <typename T>
T load(const std::string& bytes, std::size_t at) {
  return detail::load<T>(reinterpret_cast<const unsigned char*>(bytes.data()) + at);
}

/// A field that zeros, or with some writers blanks, fill up.
std::string text(const std::string& bytes, std::size_t at, std::size_t length) {
  std::string field = bytes.substr(at, length);
  field.resize(std::min(field.find('\0'), field.size()));
  while (!field.empty() && field.back() == ' ') field.pop_back();
  return field;
}

class Reader {
 public:
  Reader(std::shared_ptr<const FileBytes> bytes, bool lenient, std::vector<std::string>* notes)
      : file_(*bytes), lenient_(lenient), notes_(notes) {
    out_.bytes = std::move(bytes);
  }

  LasFile read() {
    read_header();
    read_records();
    find_points();
    read_extended_records();
    read_extra_descriptions();
    read_coordinate_system();
    return std::move(out_);
  }

 private:
  void read_header();
  void read_counts();
  void read_records();
  void find_points();
  void read_extended_records();
  void read_extra_descriptions();
  std::vector<LasExtraBytes> read_extra_descriptions(const LasRecord& record) const;
  void read_coordinate_system();
  LasRecord read_record_header(std::uint64_t start, bool extended) const;
  const LasRecord* find(const char* user, int id) const;
  /// Content of a record, cut at what a coordinate system can need.
  std::string content(const LasRecord* record) const;
  void fail_or_note(std::uint64_t byte, const std::string& found, const std::string& expected,
                    const std::string& note);

  const FileBytes& file_;
  bool lenient_;
  std::vector<std::string>* notes_;
  std::string header_;
  std::uint32_t record_count_ = 0;
  bool compressed_ = false;
  LasFile out_;
};

void Reader::fail_or_note(std::uint64_t byte, const std::string& found, const std::string& expected,
                          const std::string& note) {
  if (!lenient_) file_.fail_at(byte, found + ", expected " + expected);
  notes_->push_back(note);
}

void Reader::read_header() {
  constexpr std::size_t kShortest = 227, kLongest = 375;
  if (file_.size() < kShortest) {
    file_.fail_at(file_.size(), "found the end of the file, expected a LAS header of 227 bytes");
  }
  header_ = file_.read(0, std::min<std::uint64_t>(kLongest, file_.size()));
  const std::string& h = header_;
  if (h.compare(0, 4, "LASF") != 0) file_.fail_at(0, "found no 'LASF', expected a LAS header");
  const int major = static_cast<unsigned char>(h[24]);
  out_.minor = static_cast<unsigned char>(h[25]);
  if (major != 1 || out_.minor > 5) {
    file_.fail_at(24, "found LAS version " + std::to_string(major) + "." +
                          std::to_string(out_.minor) + ", expected 1.0 to 1.5");
  }
  const std::size_t needed = out_.minor >= 5   ? 393
                             : out_.minor == 4 ? kLongest
                             : out_.minor == 3 ? 235
                                               : kShortest;
  out_.header_size = load<std::uint16_t>(h, 94);
  if (out_.header_size < needed || out_.header_size > file_.size()) {
    file_.fail_at(94, "found a header size of " + std::to_string(out_.header_size) +
                          ", expected at least " + std::to_string(needed) +
                          " for this version, within the file");
  }
  out_.file_source_id = load<std::uint16_t>(h, 4);
  out_.global_encoding = load<std::uint16_t>(h, 6);
  out_.system_identifier = text(h, 26, 32);
  out_.generating_software = text(h, 58, 32);
  out_.creation_day = load<std::uint16_t>(h, 90);
  out_.creation_year = load<std::uint16_t>(h, 92);
  out_.points_start = load<std::uint32_t>(h, 96);
  record_count_ = load<std::uint32_t>(h, 100);
  // LASzip marks its files here.
  compressed_ = (h[104] & 0xc0) != 0;
  const int format = static_cast<unsigned char>(h[104]) & 0x3f;
  if (format > 10) {
    file_.fail_at(104, "found point format " + std::to_string(format) + ", expected 0 to 10");
  }
  out_.point_format = format;
  out_.record_length = load<std::uint16_t>(h, 105);
  if (out_.record_length < out_.standard_length()) {
    file_.fail_at(105, "found points of " + std::to_string(out_.record_length) +
                           " bytes, expected at least " + std::to_string(out_.standard_length()) +
                           " for point format " + std::to_string(format));
  }
  read_counts();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out_.scale[axis] = load<double>(h, 131 + 8 * axis);
    out_.offset[axis] = load<double>(h, 155 + 8 * axis);
    out_.maximum[axis] = load<double>(h, 179 + 16 * axis);
    out_.minimum[axis] = load<double>(h, 187 + 16 * axis);
    if (!std::isfinite(out_.scale[axis]) || out_.scale[axis] == 0.0 ||
        !std::isfinite(out_.offset[axis])) {
      file_.fail_at(131 + 8 * axis, "found scale " + std::to_string(out_.scale[axis]) +
                                        " and offset " + std::to_string(out_.offset[axis]) +
                                        ", expected finite numbers and no zero scale");
    }
  }
  if (out_.points_start < out_.header_size || out_.points_start > file_.size()) {
    file_.fail_at(96, "found points starting at byte " + std::to_string(out_.points_start) +
                          ", expected one between the header's end at " +
                          std::to_string(out_.header_size) + " and the file's at " +
                          std::to_string(file_.size()));
  }
}

void Reader::read_counts() {
  out_.legacy_count = load<std::uint32_t>(header_, 107);
  out_.declared_count = out_.legacy_count;
  if (out_.minor < 4) {
    for (std::size_t r = 0; r < 5; ++r) {
      out_.points_by_return.push_back(load<std::uint32_t>(header_, 111 + 4 * r));
    }
    return;
  }
  for (std::size_t r = 0; r < 15; ++r) {
    out_.points_by_return.push_back(load<std::uint64_t>(header_, 255 + 8 * r));
  }
  const std::uint64_t large = load<std::uint64_t>(header_, 247);
  if (out_.legacy_count != 0 && large != out_.legacy_count && large != 0 && !lenient_) {
    file_.fail_at(247, "found " + std::to_string(large) + " points, expected the " +
                           std::to_string(out_.legacy_count) + " of the older field at byte 107");
  }
  if (large != 0) out_.declared_count = large;
}

LasRecord Reader::read_record_header(std::uint64_t start, bool extended) const {
  const std::string h = file_.read(start, extended ? kLasExtendedHeader : kLasRecordHeader);
  LasRecord record;
  record.extended = extended;
  record.start = start;
  record.content = start + h.size();
  record.user_id = text(h, 2, 16);
  record.record_id = load<std::uint16_t>(h, 18);
  record.length = extended ? load<std::uint64_t>(h, 20) : load<std::uint16_t>(h, 20);
  record.description = text(h, extended ? 28 : 22, 32);
  return record;
}

void Reader::read_records() {
  std::uint64_t at = out_.header_size;
  for (std::uint32_t i = 0; i < record_count_; ++i) {
    const auto fail = [&](const std::string& found) {
      fail_or_note(at, found,
                   std::to_string(record_count_) + " variable-length records between bytes " +
                       std::to_string(out_.header_size) + " and " +
                       std::to_string(out_.points_start),
                   "of " + std::to_string(record_count_) + " variable-length records " +
                       std::to_string(i) + " are sound");
    };
    const std::uint64_t room = out_.points_start - at;
    if (room < kLasRecordHeader) {
      fail("found no room for record " + std::to_string(i + 1));
      break;
    }
    LasRecord record = read_record_header(at, false);
    if (record.length > room - kLasRecordHeader) {
      fail("found record " + std::to_string(i + 1) + " with " + std::to_string(record.length) +
           " bytes that reach into the points");
      break;
    }
    at = record.content + record.length;
    out_.records.push_back(std::move(record));
  }
  out_.records_end = at;
}

void Reader::find_points() {
  const std::uint64_t fitting = (file_.size() - out_.points_start) / out_.record_length;
  const LasRecord* const compression = find(laz::kRecordUser, laz::kRecordId);
  if (compressed_ && compression == nullptr) {
    file_.fail_at(104,
                  "found compressed points (LAZ) without LASzip's record, expected one among the " +
                      std::to_string(out_.records.size()) + " variable-length records");
  }
  if (compression != nullptr && !compressed_ && fitting < out_.declared_count) {
    compressed_ = true;
    notes_->emplace_back(
        "the header does not say that the points are compressed (LAZ), their record does");
  }
  if (compressed_) return laz::read_layout(&out_, *compression, lenient_, notes_);
  out_.points = std::min(out_.declared_count, fitting);
  out_.points_end = out_.points_start + out_.points * out_.record_length;
  out_.tail_end = file_.size();
  if (out_.points < out_.declared_count && !lenient_) {
    file_.fail_at(file_.size(), "found the end of the file after at most " +
                                    std::to_string(fitting) + " points, expected " +
                                    std::to_string(out_.declared_count));
  }
}

/// Version 1.3 has at most one, with the wave packets; from 1.4 on the header has their number.
void Reader::read_extended_records() {
  if (out_.minor < 3) return;
  std::uint64_t at =
      out_.minor >= 4 ? load<std::uint64_t>(header_, 235) : load<std::uint64_t>(header_, 227);
  const bool waves_within = (out_.global_encoding & 2) != 0;
  const std::uint64_t count = out_.minor >= 4           ? load<std::uint32_t>(header_, 243)
                              : waves_within && at != 0 ? 1
                                                        : 0;
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto fail = [&](const std::string& found) {
      fail_or_note(
          at, found,
          std::to_string(count) + " extended records between the points' end at byte " +
              std::to_string(out_.points_end) + " and the file's at " +
              std::to_string(file_.size()),
          "of " + std::to_string(count) + " extended records " + std::to_string(i) + " are sound");
    };
    if (at < out_.points_end || at > file_.size() || file_.size() - at < kLasExtendedHeader) {
      return fail("found no room for extended record " + std::to_string(i + 1));
    }
    LasRecord record = read_record_header(at, true);
    if (record.length > file_.size() - record.content) {
      return fail("found extended record " + std::to_string(i + 1) + " with " +
                  std::to_string(record.length) + " bytes, more than the file has");
    }
    at = record.content + record.length;
    out_.records.push_back(std::move(record));
  }
}

const LasRecord* Reader::find(const char* user, int id) const {
  for (const LasRecord& record : out_.records) {
    if (record.user_id == user && record.record_id == id) return &record;
  }
  return nullptr;
}

std::string Reader::content(const LasRecord* record) const {
  if (!record) return {};
  return file_.read(record->content, std::min(record->length, kMostCrsBytes));
}

/// Where several programs have added attributes, each may have added a record. One that describes
/// all bytes by itself stands for all of them.
void Reader::read_extra_descriptions() {
  std::vector<std::vector<LasExtraBytes>> by_record;
  for (const LasRecord& record : out_.records) {
    if (record.user_id == "LASF_Spec" && record.record_id == 4) {
      by_record.push_back(read_extra_descriptions(record));
      out_.extra_bytes.insert(out_.extra_bytes.end(), by_record.back().begin(),
                              by_record.back().end());
    }
  }
  if (by_record.size() < 2 || out_.described_length() <= out_.extra_length()) return;
  for (const std::vector<LasExtraBytes>& one : by_record) {
    std::size_t length = 0;
    for (const LasExtraBytes& extra : one) length += extra.size;
    if (length == out_.extra_length()) out_.extra_bytes = one;
  }
}

std::vector<LasExtraBytes> Reader::read_extra_descriptions(const LasRecord& record) const {
  std::vector<LasExtraBytes> out;
  const std::string all = file_.read(record.content, std::min(record.length, kMostDescriptions));
  for (std::size_t at = 0; at + kLasExtraDescription <= all.size(); at += kLasExtraDescription) {
    LasExtraBytes extra;
    extra.content = record.content + at;
    extra.type = static_cast<unsigned char>(all[at + 2]);
    extra.options = static_cast<unsigned char>(all[at + 3]);
    extra.name = text(all, at + 4, 32);
    extra.description = text(all, at + 160, 32);
    if (extra.type > 30) {
      file_.fail_at(record.content + at + 2, "found extra bytes of type " +
                                                 std::to_string(extra.type) + ", expected 0 to 30");
    }
    if (extra.type == 0) {
      extra.size = static_cast<std::size_t>(extra.options);
      extra.options = 0;
    } else {
      extra.elements = static_cast<std::size_t>((extra.type - 1) / 10 + 1);
      extra.size = extra.elements * size_of(detail::las_extra_type(extra.type));
      for (std::size_t k = 0; k < extra.elements; ++k) {
        if (extra.options & 0x08) extra.scale[k] = load<double>(all, at + 112 + 8 * k);
        if (extra.options & 0x10) extra.offset[k] = load<double>(all, at + 136 + 8 * k);
      }
    }
    out.push_back(std::move(extra));
  }
  return out;
}

/// The header's bit 4 decides which of the two kinds counts; the other is taken where there is one
/// only.
void Reader::read_coordinate_system() {
  constexpr int kWkt = 2112, kKeys = 34735, kDoubles = 34736, kText = 34737;
  const char* const user = "LASF_Projection";
  const bool wkt_bit = (out_.global_encoding & 16) != 0;
  const LasRecord* wkt = find(user, kWkt);
  const LasRecord* const keys = find(user, kKeys);
  const CoordinateSystem from_keys =
      keys ? coordinate_system_from_geotiff(read_geotiff_keys(
                 content(keys), content(find(user, kDoubles)), content(find(user, kText))))
           : CoordinateSystem();
  const CoordinateSystem from_wkt =
      wkt ? coordinate_system_from_wkt(content(wkt)) : CoordinateSystem();
  using Kind = CoordinateSystem::Kind;
  const bool use_wkt =
      from_wkt.kind != Kind::kUnknown && (wkt_bit || from_keys.kind == Kind::kUnknown);
  out_.crs = use_wkt ? from_wkt : from_keys;
  out_.crs.wkt = from_wkt.wkt;
  out_.crs.geotiff_keys = from_keys.geotiff_keys;
  out_.crs.wkt_bit = wkt_bit;
  // Heights: the other kind may state what the one that counts leaves open.
  if (use_wkt && !out_.crs.vertical_stated && from_keys.vertical_stated) {
    out_.crs.vertical = from_keys.vertical;
    out_.crs.vertical_epsg = from_keys.vertical_epsg;
    out_.crs.vertical_stated = true;
  }
  if (use_wkt && out_.crs.epsg == 0) out_.crs.epsg = from_keys.epsg;
}

}  // namespace

std::size_t LasFile::standard_length() const { return detail::las_point_format(point_format).size; }

std::size_t LasFile::described_length() const {
  std::size_t length = 0;
  for (const LasExtraBytes& extra : extra_bytes) length += extra.size;
  return length;
}

std::vector<std::string> LasFile::contradictions() const {
  std::vector<std::string> out;
  if (point_format >= 6 && legacy_count != 0) {
    out.push_back("the older count of points is " + std::to_string(legacy_count) +
                  ", expected 0 with point format " + std::to_string(point_format));
  }
  if (described_length() != extra_length()) {
    out.push_back("of " + std::to_string(extra_length()) + " extra bytes a point " +
                  std::to_string(described_length()) + " are described");
  }
  return out;
}

LasFile read_las_file(std::shared_ptr<const FileBytes> bytes, bool lenient,
                      std::vector<std::string>* notes) {
  return Reader(std::move(bytes), lenient, notes).read();
}

}  // namespace camber
