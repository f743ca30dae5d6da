// Points of a LAS file into another LAS file: header, records and what stands behind the points
// stay byte for byte as they are, but for what changed. The ASPRS specifications 1.0 to 1.5.

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/copc.h"
#include "camber/cloud/detail/laz/laz_writer.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/las_file.h"

namespace camber {
namespace {

using detail::kLasExtraDescription;
using detail::kLasRecordHeader;
using detail::las_point_format;
using detail::load;
using detail::store;

constexpr std::uint64_t kChunk = 1 << 20;  // bytes

class LasCopySink : public PointSink {
 public:
  LasCopySink(std::ostream& out, const PointStreamHeader& header, LasPoints points)
      : out_(out),
        header_(header),
        compress_(points == LasPoints::kCompressed),
        extended_(points == LasPoints::kExtended),
        las_(*header.las),
        from_(las_point_format(las_.point_format)) {
    format_id_ = extended_ ? detail::las_extended_format(las_.point_format) : las_.point_format;
    format_ = las_point_format(format_id_);
    copc_ = laz::is_copc(las_);
    find_changes();
    start_ = out_.tellp();
    head_ = las_.bytes->read(0, las_.header_size);
    if (extended_) extend_head();
    write_head();
    if (compress_) {
      laz_ = std::make_unique<laz::LazWriter>(out_, start_, format_id_, record_length_);
    }
  }

  void write(const PointBatch& batch) override {
    if (batch.records.data == nullptr && batch.count > 0) {
      throw std::invalid_argument("the points have no LAS records, expected those of their file");
    }
    rows_.assign(batch.count * record_length_, '\0');
    for (std::size_t i = 0; i < batch.count; ++i) {
      char* const row = rows_.data() + i * record_length_;
      copy_record(batch.records.data + i * batch.records.stride, row);
      for (const Change& change : changes_) {
        const FieldView& view = batch.fields[change.field];
        if (change.classification) {
          set_class(row, view.get<std::uint8_t>(i));
        } else {
          std::memcpy(row + change.offset, view.data + i * view.stride, size_of(change.type));
        }
      }
      count_point(reinterpret_cast<const unsigned char*>(row));
    }
    if (laz_) {
      laz_->write(rows_.data(), batch.count);
    } else {
      out_.write(rows_.data(), static_cast<std::streamsize>(rows_.size()));
    }
  }

  void finish() override {
    if (laz_) laz_->finish();
    const auto points_end =
        static_cast<std::uint64_t>(static_cast<std::streamoff>(out_.tellp() - start_));
    copy_tail();
    move_extended_records(points_end);
    // Where all points are there, the header keeps its counts and bounds.
    if (count_ != las_.declared_count || extended_) count_in_header();
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    out_.write(head_.data(), static_cast<std::streamsize>(head_.size()));
    out_.seekp(end);
  }

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes;
    const bool waves_beside = format_.wave >= 0 && (las_.global_encoding & 4) != 0;
    if (extended_ && from_.wave >= 0) {
      notes.emplace_back("wave packets are not kept: COPC has none");
    }
    if (overlapping_ > 0) {
      notes.push_back(std::to_string(overlapping_) +
                      " points of class 12 (overlap) have the overlap flag and class 1, as point "
                      "formats from 6 on have it");
    }
    if (extended_ && !from_.extended && has_geotiff_keys_alone()) {
      notes.emplace_back(
          "the coordinate system stays in GeoTIFF keys, as its well-known text is not known: some "
          "programs read none of these in COPC files (--crs with well-known text replaces them)");
    }
    if (waves_beside) {
      notes.emplace_back(
          "the waveforms are in a .wdp file of the input's name, which is not copied");
    }
    if (copc_ && !extended_) notes.emplace_back("COPC's index of the points is not kept");
    return notes;
  }

 private:
  struct Change {
    std::size_t field = 0;
    bool classification = false;
    ScalarType type = ScalarType::kInt32;
    std::size_t offset = 0;  // in the record
  };

  void find_changes();
  void extend_head();
  bool has_geotiff_keys_alone() const;
  void copy_record(const unsigned char* from, char* row);
  std::string describe_extra_bytes() const;
  void write_head();
  std::string changed_records(std::uint32_t* count) const;
  void copy_bytes(std::uint64_t from, std::uint64_t to);
  void copy_tail();
  void copy_extended_records();
  void move_extended_records(std::uint64_t points_end);
  void count_in_header();
  /// How the input's points are compressed, and COPC's index of them, have no meaning in the
  /// output.
  bool is_dropped(const LasRecord& record) const {
    const bool compression = (las_.laz || compress_) && record.user_id == laz::kRecordUser &&
                             record.record_id == laz::kRecordId;
    constexpr int kFirstWaveForm = 100, kLastWaveForm = 354, kWaveForms = 65535;
    const bool waves = extended_ && from_.wave >= 0 && record.user_id == "LASF_Spec" &&
                       ((record.record_id >= kFirstWaveForm && record.record_id <= kLastWaveForm) ||
                        record.record_id == kWaveForms);
    return compression || waves || (copc_ && record.user_id == laz::kCopcUser);
  }
  bool is_replaced(const LasRecord& record) const {
    const bool crs = header_.crs && header_.crs->given;
    return (crs && detail::is_projection_record(record.user_id, record.record_id)) ||
           (!new_fields_.empty() && describes_extra_bytes(record));
  }
  static bool describes_extra_bytes(const LasRecord& record) {
    return record.user_id == "LASF_Spec" && record.record_id == 4;
  }

  void set_class(char* row, unsigned value) const {
    if (format_.extended) {
      const bool overlap =
          !from_.extended && value == static_cast<unsigned>(detail::kLasOverlapClass);
      if (overlap) row[15] = static_cast<char>(static_cast<unsigned char>(row[15]) | 8u);
      row[16] = static_cast<char>(overlap ? 1u : value);
    } else {
      const unsigned flags = static_cast<unsigned char>(row[15]) & 0xe0u;
      row[15] = static_cast<char>(flags | std::min(value, 31u));
    }
  }

  void count_point(const unsigned char* row) {
    const unsigned number = row[14] & (format_.extended ? 15u : 7u);
    if (number > 0) ++by_return_[number - 1];  // 0 is no return
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t x = load<std::int32_t>(row + 4 * axis);
      low_[axis] = std::min(low_[axis], x);
      high_[axis] = std::max(high_[axis], x);
    }
    if (las_.minor >= 5 && format_.time >= 0) {
      const double time = load<double>(row + format_.time);
      first_time_ = std::min(first_time_, time);
      last_time_ = std::max(last_time_, time);
    }
    ++count_;
  }

  std::ostream& out_;
  PointStreamHeader header_;
  bool compress_, extended_;
  std::unique_ptr<laz::LazWriter> laz_;
  const LasFile& las_;
  bool copc_ = false;
  std::uint32_t dropped_records_ = 0;  // behind the points
  detail::LasPointFormat from_;        // the input's
  int format_id_ = 0;
  detail::LasPointFormat format_;
  std::uint64_t overlapping_ = 0;
  std::vector<Change> changes_;
  std::vector<std::size_t> new_fields_;  // that become extra bytes
  std::size_t record_length_ = 0;
  std::string head_, rows_;
  std::ostream::pos_type start_ = 0;
  std::uint64_t points_start_ = 0;
  std::uint64_t count_ = 0;
  std::array<std::uint64_t, 15> by_return_{};
  std::array<std::int32_t, 3> low_{INT32_MAX, INT32_MAX, INT32_MAX};
  std::array<std::int32_t, 3> high_{INT32_MIN, INT32_MIN, INT32_MIN};
  double first_time_ = std::numeric_limits<double>::infinity();
  double last_time_ = -std::numeric_limits<double>::infinity();
};

/// Changed attributes go where the record has them; those that it does not have become extra bytes.
void LasCopySink::find_changes() {
  record_length_ = format_.size + las_.extra_length();
  for (std::size_t f = 0; f < header_.fields.size(); ++f) {
    const PointField& field = header_.fields[f];
    if (!field.changed) continue;
    Change change;
    change.field = f;
    change.type = field.type;
    change.classification = field.name == "classification" && field.type == ScalarType::kUint8;
    std::size_t at = format_.size;
    for (const LasExtraBytes& extra : las_.extra_bytes) {
      const bool same = extra.elements == 1 && !extra.scaled() && extra.name == field.name &&
                        detail::las_extra_type(extra.type) == field.type;
      if (same && at + extra.size <= format_.size + las_.extra_length()) change.offset = at;
      at += extra.size;
    }
    if (!change.classification && change.offset == 0) {
      change.offset = record_length_;
      record_length_ += size_of(field.type);
      new_fields_.push_back(f);
    }
    changes_.push_back(change);
  }
  if (record_length_ > UINT16_MAX) {
    throw std::invalid_argument("a point would have " + std::to_string(record_length_) +
                                " bytes, expected at most 65535 for LAS");
  }
}

/// The header of version 1.4, without what has no meaning behind it.
void LasCopySink::extend_head() {
  constexpr std::size_t kHeaderSize = 375;
  constexpr unsigned kTimeOffset = 32, kWaveForms = 2 | 4, kText = 16;
  if (las_.minor >= 5 && (las_.global_encoding & kTimeOffset) != 0) {
    throw std::invalid_argument(
        "found GPS times from an offset of LAS 1.5, expected none for COPC, which is LAS 1.4");
  }
  head_.resize(kHeaderSize, '\0');
  if (las_.minor < 4) std::fill(head_.begin() + (las_.minor < 3 ? 227 : 235), head_.end(), '\0');
  head_[25] = 4;
  unsigned encoding = las_.minor < 2 ? 0u : las_.global_encoding & ~kWaveForms;
  encoding = has_geotiff_keys_alone() ? encoding & ~kText : encoding | kText;
  store(head_, 6, static_cast<std::uint16_t>(encoding));
  store(head_, 94, static_cast<std::uint16_t>(kHeaderSize));
  store(head_, 227, std::uint64_t{0});
}

bool LasCopySink::has_geotiff_keys_alone() const {
  if (header_.crs && header_.crs->given) return false;
  bool keys = false;
  for (const LasRecord& record : las_.records) {
    if (!detail::is_projection_record(record.user_id, record.record_id)) continue;
    constexpr int kWkt = 2112;
    if (record.record_id == kWkt) return false;
    keys = keys || record.record_id >= 34735;
  }
  return keys;
}

void LasCopySink::copy_record(const unsigned char* from, char* row) {
  if (format_id_ == las_.point_format) {
    std::memcpy(row, from, las_.record_length);
    return;
  }
  if (!from_.extended && detail::las_class_of(from, from_) == detail::kLasOverlapClass) {
    ++overlapping_;
  }
  detail::extend_las_record(from, from_, reinterpret_cast<unsigned char*>(row), format_);
  std::memcpy(row + format_.size, from + from_.size, las_.extra_length());
}

/// The descriptions that the file has, of all its records, and those of what is appended. Bytes
/// between them that nothing describes are described as such: descriptions count from the first
/// extra byte.
std::string LasCopySink::describe_extra_bytes() const {
  std::string out;
  for (const LasExtraBytes& extra : las_.extra_bytes) {
    out += las_.bytes->read(extra.content, kLasExtraDescription);
  }
  const std::size_t described = las_.described_length(), there = las_.extra_length();
  if (described > there) {
    throw std::invalid_argument(
        "the file's extra bytes do not fit their description: no attribute can be added");
  }
  for (std::size_t left = there - described; left > 0;) {
    const std::size_t some = std::min<std::size_t>(left, 255);
    std::string d(kLasExtraDescription, '\0');
    d[3] = static_cast<char>(some);
    out += d;
    left -= some;
  }
  for (const std::size_t f : new_fields_) {
    out += detail::describe_extra_bytes(header_.fields[f].name, header_.fields[f].type);
  }
  if (out.size() > UINT16_MAX) {
    throw std::invalid_argument("the file has too many extra attributes to add one");
  }
  return out;
}

/// The records before the points, with one of extra bytes that describes all of them where some are
/// new, and with the coordinate system that was given, if one was.
std::string LasCopySink::changed_records(std::uint32_t* count) const {
  std::string out;
  bool described = new_fields_.empty();
  for (const LasRecord& record : las_.records) {
    if (record.extended || is_dropped(record)) continue;
    if (!is_replaced(record)) {
      out += las_.bytes->read(record.start, kLasRecordHeader + record.length);
    } else if (!described && describes_extra_bytes(record)) {
      std::string bytes = las_.bytes->read(record.start, kLasRecordHeader) + describe_extra_bytes();
      store(bytes, 20, static_cast<std::uint16_t>(bytes.size() - kLasRecordHeader));
      out += bytes;
      described = true;
    } else {
      continue;
    }
    ++*count;
  }
  if (!described) {
    out += detail::las_record("LASF_Spec", 4, "extra bytes", describe_extra_bytes());
    ++*count;
  }
  if (header_.crs && header_.crs->given) {
    out += detail::projection_records(*header_.crs, format_id_, count);
  }
  if (compress_) {
    out += laz::writer_record(format_id_, record_length_);
    ++*count;
  }
  return out;
}

void LasCopySink::copy_bytes(std::uint64_t from, std::uint64_t to) {
  for (std::uint64_t at = from; at < to;) {
    const std::string part = las_.bytes->read(at, std::min(kChunk, to - at));
    out_.write(part.data(), static_cast<std::streamsize>(part.size()));
    at += part.size();
  }
}

void LasCopySink::write_head() {
  const bool crs = header_.crs && header_.crs->given;
  if (new_fields_.empty() && !crs && !las_.laz && !compress_ && !extended_) {
    points_start_ = las_.points_start;
    out_.write(head_.data(), static_cast<std::streamsize>(head_.size()));
    return copy_bytes(las_.header_size, las_.points_start);
  }
  std::uint32_t count = 0;
  const std::string records = changed_records(&count);
  const std::uint64_t gap = extended_ ? 0 : las_.points_start - las_.records_end;
  points_start_ = head_.size() + records.size() + gap;
  if (points_start_ > UINT32_MAX) {
    throw std::invalid_argument("the records before the points have more than 4 GB");
  }
  store(head_, 96, static_cast<std::uint32_t>(points_start_));
  store(head_, 100, count);
  store(head_, 104, static_cast<std::uint8_t>(format_id_ | (compress_ ? 0x80 : 0)));
  store(head_, 105, static_cast<std::uint16_t>(record_length_));
  if (crs && (las_.minor >= 4 || extended_)) {
    const bool wkt = detail::takes_wkt(*header_.crs, format_id_);
    const unsigned encoding =
        load<std::uint16_t>(reinterpret_cast<const unsigned char*>(head_.data()) + 6);
    store(head_, 6, static_cast<std::uint16_t>(wkt ? encoding | 16u : encoding & ~16u));
  }
  out_.write(head_.data(), static_cast<std::streamsize>(head_.size()));
  out_.write(records.data(), static_cast<std::streamsize>(records.size()));
  if (!extended_) copy_bytes(las_.records_end, las_.points_start);
}

/// What stands behind the points. A coordinate system or a description of extra bytes there that
/// another one replaces is marked as superseded (LASF_Spec 7).
void LasCopySink::copy_tail() {
  if (extended_) return copy_extended_records();
  std::uint64_t at = las_.points_end;
  for (const LasRecord& record : las_.records) {
    if (!record.extended || (!is_replaced(record) && !is_dropped(record))) continue;
    copy_bytes(at, record.start);
    at = record.content + record.length;
    if (is_dropped(record)) {
      ++dropped_records_;
      continue;
    }
    std::string h = las_.bytes->read(record.start, detail::kLasExtendedHeader);
    store(h, 2, "LASF_Spec\0\0\0\0\0\0\0", 16);
    store(h, 18, std::uint16_t{7});
    out_.write(h.data(), static_cast<std::streamsize>(h.size()));
    at = record.content;
  }
  copy_bytes(at, las_.tail_end);
}

/// Of what stands behind the points the records that have a meaning, one behind the other.
void LasCopySink::copy_extended_records() {
  std::uint32_t count = 0;
  store(head_, 235, static_cast<std::uint64_t>(static_cast<std::streamoff>(out_.tellp() - start_)));
  for (const LasRecord& record : las_.records) {
    if (!record.extended || is_replaced(record) || is_dropped(record)) continue;
    copy_bytes(record.start, record.content + record.length);
    ++count;
  }
  store(head_, 243, count);
  if (count == 0) store(head_, 235, std::uint64_t{0});
}

void LasCopySink::move_extended_records(std::uint64_t points_end) {
  if (extended_) return;
  const auto move = [&](std::size_t place) {
    const std::uint64_t old =
        load<std::uint64_t>(reinterpret_cast<const unsigned char*>(head_.data()) + place);
    if (old >= las_.points_end) store(head_, place, old - las_.points_end + points_end);
  };
  if (las_.minor >= 3) move(227);  // wave packets
  if (las_.minor >= 4) move(235);  // extended records
  if (dropped_records_ == 0) return;
  const auto count = load<std::uint32_t>(reinterpret_cast<const unsigned char*>(&head_[243]));
  store(head_, 243, count - dropped_records_);
  if (count == dropped_records_) store(head_, 235, std::uint64_t{0});
}

/// Counts and bounds of the points that were written.
void LasCopySink::count_in_header() {
  const bool old_fields = !format_.extended || (las_.legacy_count != 0 && !extended_);
  const int minor = extended_ ? 4 : las_.minor;
  if (minor < 4 && count_ > UINT32_MAX) {
    throw std::invalid_argument("the file has more points than LAS 1." +
                                std::to_string(las_.minor) + " can hold");
  }
  const bool fits = old_fields && count_ <= UINT32_MAX;
  store(head_, 107, static_cast<std::uint32_t>(fits ? count_ : 0));
  for (std::size_t r = 0; r < 5; ++r) {
    store(head_, 111 + 4 * r,
          static_cast<std::uint32_t>(fits && !format_.extended ? by_return_[r] : 0));
  }
  if (minor >= 4) {
    store(head_, 247, count_);
    for (std::size_t r = 0; r < 15; ++r) store(head_, 255 + 8 * r, by_return_[r]);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double a = count_ == 0 ? 0.0 : low_[axis] * las_.scale[axis] + las_.offset[axis];
    const double b = count_ == 0 ? 0.0 : high_[axis] * las_.scale[axis] + las_.offset[axis];
    store(head_, 179 + 16 * axis, std::max(a, b));
    store(head_, 187 + 16 * axis, std::min(a, b));
  }
  if (minor >= 5 && last_time_ >= first_time_) {
    store(head_, 375, last_time_);
    store(head_, 383, first_time_);
  }
}

}  // namespace

std::unique_ptr<PointSink> make_las_copy_sink(std::ostream& out, const PointStreamHeader& header,
                                              LasPoints points) {
  return std::make_unique<LasCopySink>(out, header, points);
}

}  // namespace camber
