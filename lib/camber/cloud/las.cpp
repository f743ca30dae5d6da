// LAS files, versions 1.0 to 1.4, point formats 0 to 10, uncompressed: the ASPRS specifications
// ("LAS Specification 1.4 - R15", 2019, and its predecessors).

#include <algorithm>
#include <cmath>
#include <set>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

using detail::kLasAngleUnit;
using detail::kLasExtraDescription;
using detail::kLasRecordHeader;
using detail::las_extra_type;
using detail::las_point_format;
using detail::LasPointFormat;
using detail::load;

constexpr std::size_t kMostExtraBytes = 1 << 14;  // a point

/// What to take out of a record for one column.
struct Column {
  enum class Kind { kPlain, kCoordinate, kBits, kScaled } kind = Kind::kPlain;
  std::size_t offset = 0;
  ScalarType stored = ScalarType::kUint8;
  unsigned shift = 0, mask = 0xff;  // kBits, of one byte
  double scale = 1.0, shift_by = 0.0;
};

class LasSource : public FormatSource {
 public:
  LasSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kLas;
    read_header();
  }

  bool next(PointBatch& batch) override {
    batch.count = 0;
    batch.fields.clear();
    file_->consume(pending_);
    pending_ = 0;
    if (left_ == 0) return false;
    file_->fill(record_size_);
    const std::size_t count = static_cast<std::size_t>(std::min<std::uint64_t>(
        std::min<std::uint64_t>(left_, kBatchSize), file_->available() / record_size_));
    const unsigned char* const data = file_->data();
    pending_ = count * record_size_;
    left_ -= count;
    batch.count = count;
    report_.points += count;
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      const Column& column = columns_[c];
      const unsigned char* const first = data + column.offset;
      if (column.kind == Column::Kind::kPlain) {
        batch.fields.push_back({first, record_size_});
        continue;
      }
      std::vector<unsigned char>& values = values_[c];
      if (column.kind == Column::Kind::kBits) {
        values.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
          values[i] =
              static_cast<unsigned char>(first[i * record_size_] >> column.shift & column.mask);
        }
        batch.fields.push_back({values.data(), 1});
        continue;
      }
      values.resize(count * sizeof(double));
      with_type(column.stored, [&](auto tag) {
        for (std::size_t i = 0; i < count; ++i) {
          const double value =
              static_cast<double>(load<decltype(tag)>(first + i * record_size_)) * column.scale +
              column.shift_by;
          std::memcpy(values.data() + i * sizeof(double), &value, sizeof(double));
        }
      });
      batch.fields.push_back({values.data(), sizeof(double)});
    }
    return true;
  }

 private:
  void read_header();
  void read_records(std::uint64_t first, std::uint64_t end, std::uint32_t count);
  void read_extra_descriptions(const unsigned char* data, std::size_t size);
  void add_standard_columns(const LasPointFormat& format);
  void add_extra_columns(const LasPointFormat& format);
  void add(const std::string& name, ScalarType type, const Column& column);
  void add_plain(const std::string& name, ScalarType type, std::size_t offset);
  void add_bits(const std::string& name, std::size_t offset, unsigned shift, unsigned mask);

  struct Extra {
    std::string name;
    int type = 0;
    std::size_t size = 0;  // type 0: bytes that nothing is known of
    bool scaled = false;
    double scale = 1.0, offset = 0.0;
  };

  std::size_t record_size_ = 0;
  std::uint64_t left_ = 0;
  std::size_t pending_ = 0;
  std::vector<Column> columns_;
  std::vector<std::vector<unsigned char>> values_;
  std::vector<Extra> extras_;
  double scale_[3] = {1, 1, 1}, offset_[3] = {0, 0, 0};
};

void LasSource::read_header() {
  constexpr std::size_t kShortest = 227, kLongest = 375;
  if (!file_->fill(kShortest)) {
    file_->fail_at(file_->size(), "found the end of the file, expected a LAS header of 227 bytes");
  }
  file_->fill(std::min<std::uint64_t>(kLongest, file_->remaining()));
  const unsigned char* const h = file_->data();
  if (std::memcmp(h, "LASF", 4) != 0) file_->fail_at(0, "found no 'LASF', expected a LAS header");
  const int major = h[24], minor = h[25];
  if (major != 1 || minor > 4) {
    file_->fail_at(24, "found LAS version " + std::to_string(major) + "." + std::to_string(minor) +
                           ", expected 1.0 to 1.4");
  }
  report_.encoding = "version 1." + std::to_string(minor);
  const std::size_t needed = minor >= 4 ? kLongest : minor == 3 ? 235 : kShortest;
  const std::uint16_t header_size = load<std::uint16_t>(h + 94);
  if (header_size < needed || header_size > file_->size()) {
    file_->fail_at(94, "found a header size of " + std::to_string(header_size) +
                           ", expected at least " + std::to_string(needed) +
                           " for this version, within the file");
  }
  const std::uint32_t data_start = load<std::uint32_t>(h + 96);
  const std::uint32_t record_count = load<std::uint32_t>(h + 100);
  const int format_byte = h[104];
  if ((format_byte & 0xc0) != 0) {
    throw InputError(
        file_->name(),
        "found LAZ (compressed LAS), which is not supported; expected uncompressed LAS "
        "(laszip or pdal convert it)");
  }
  if (format_byte > 10) {
    file_->fail_at(104, "found point format " + std::to_string(format_byte) + ", expected 0 to 10");
  }
  record_size_ = load<std::uint16_t>(h + 105);
  const LasPointFormat format = las_point_format(format_byte);
  if (record_size_ < format.size) {
    file_->fail_at(105, "found points of " + std::to_string(record_size_) +
                            " bytes, expected at least " + std::to_string(format.size) +
                            " for point format " + std::to_string(format_byte));
  }
  report_.encoding += ", point format " + std::to_string(format_byte);
  std::uint64_t count = load<std::uint32_t>(h + 107);
  if (minor >= 4) {
    const std::uint64_t large = load<std::uint64_t>(h + 247);
    if (count != 0 && large != count && large != 0 && !options_.lenient) {
      file_->fail_at(247, "found " + std::to_string(large) + " points, expected the " +
                              std::to_string(count) + " of the older field at byte 107");
    }
    if (large != 0) count = large;
  }
  for (int axis = 0; axis < 3; ++axis) {
    scale_[axis] = load<double>(h + 131 + 8 * axis);
    offset_[axis] = load<double>(h + 155 + 8 * axis);
    if (!std::isfinite(scale_[axis]) || scale_[axis] == 0.0 || !std::isfinite(offset_[axis])) {
      file_->fail_at(static_cast<std::uint64_t>(131 + 8 * axis),
                     "found scale " + std::to_string(scale_[axis]) + " and offset " +
                         std::to_string(offset_[axis]) +
                         ", expected finite numbers and no zero scale");
    }
  }
  if (data_start < header_size || data_start > file_->size()) {
    file_->fail_at(96, "found points starting at byte " + std::to_string(data_start) +
                           ", expected one between the header's end at " +
                           std::to_string(header_size) + " and the file's at " +
                           std::to_string(file_->size()));
  }
  header_.grid = PointGrid{{scale_[0], scale_[1], scale_[2]}, {offset_[0], offset_[1], offset_[2]}};
  file_->skip(header_size);
  read_records(header_size, data_start, record_count);
  file_->skip(data_start - file_->position());
  report_.declared = count;
  left_ = check_count(count, record_size_, file_->remaining(), "points");
  report_.drop("truncated", count - left_);
  header_.count = left_;
  add_standard_columns(format);
  add_extra_columns(format);
}

/// Walks the variable-length records; two kinds of them are looked into.
void LasSource::read_records(std::uint64_t first, std::uint64_t end, std::uint32_t count) {
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint64_t start = file_->position();
    const auto fail = [&](const std::string& found) {
      if (!options_.lenient) {
        file_->fail_at(start, found + ", expected " + std::to_string(count) +
                                  " variable-length records between bytes " +
                                  std::to_string(first) + " and " + std::to_string(end));
      }
      report_.notes.push_back("of " + std::to_string(count) + " variable-length records " +
                              std::to_string(i) + " are sound");
    };
    if (end - start < kLasRecordHeader || !file_->fill(kLasRecordHeader)) {
      return fail("found no room for record " + std::to_string(i + 1));
    }
    const unsigned char* const h = file_->data();
    const char* const user = reinterpret_cast<const char*>(h + 2);
    const std::string user_id(user,
                              static_cast<std::size_t>(std::find(user, user + 16, '\0') - user));
    const std::uint16_t id = load<std::uint16_t>(h + 18);
    const std::uint16_t length = load<std::uint16_t>(h + 20);
    if (length > end - start - kLasRecordHeader) {
      return fail("found record " + std::to_string(i + 1) + " with " + std::to_string(length) +
                  " bytes that reach into the points");
    }
    file_->consume(kLasRecordHeader);
    file_->fill(length);
    if (user_id == "LASF_Spec" && id == 4) read_extra_descriptions(file_->data(), length);
    if (user_id == "Camber" && id == 1) {
      std::string_view text(file_->text(), length);
      while (!text.empty()) {
        const std::size_t line = std::min(text.find('\n'), text.size());
        read_comment(text.substr(0, line));
        text.remove_prefix(std::min(line + 1, text.size()));
      }
    }
    file_->consume(length);
  }
}

void LasSource::read_extra_descriptions(const unsigned char* data, std::size_t size) {
  for (std::size_t at = 0; at + kLasExtraDescription <= size; at += kLasExtraDescription) {
    const unsigned char* const d = data + at;
    Extra extra;
    extra.type = d[2];
    const char* const name = reinterpret_cast<const char*>(d + 4);
    extra.name.assign(name, std::find(name, name + 32, '\0'));
    const int options = d[3];
    if (extra.type == 0) {
      extra.size = static_cast<std::size_t>(options);
    } else if (extra.type <= 30) {
      const std::size_t elements = static_cast<std::size_t>((extra.type - 1) / 10 + 1);
      extra.size = elements * size_of(las_extra_type(extra.type));
      extra.scaled = (options & 0x18) != 0;
      if (options & 0x08) extra.scale = load<double>(d + 112);
      if (options & 0x10) extra.offset = load<double>(d + 136);
    } else {
      file_->fail_at(
          file_->position() + at + 2,
          "found extra bytes of type " + std::to_string(extra.type) + ", expected 0 to 30");
    }
    extras_.push_back(extra);
  }
}

void LasSource::add(const std::string& name, ScalarType type, const Column& column) {
  PointField field;
  field.name = name;
  field.type = type;
  header_.fields.push_back(field);
  columns_.push_back(column);
  values_.emplace_back();
}

void LasSource::add_plain(const std::string& name, ScalarType type, std::size_t offset) {
  Column column;
  column.offset = offset;
  column.stored = type;
  add(name, type, column);
}

void LasSource::add_bits(const std::string& name, std::size_t offset, unsigned shift,
                         unsigned mask) {
  Column column;
  column.kind = Column::Kind::kBits;
  column.offset = offset;
  column.shift = shift;
  column.mask = mask;
  add(name, ScalarType::kUint8, column);
}

void LasSource::add_standard_columns(const LasPointFormat& format) {
  const char* const axes[] = {"x", "y", "z"};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Column column;
    column.kind = Column::Kind::kCoordinate;
    column.offset = 4 * axis;
    column.stored = ScalarType::kInt32;
    column.scale = scale_[axis];
    column.shift_by = offset_[axis];
    add(axes[axis], ScalarType::kFloat64, column);
  }
  add_plain("intensity", ScalarType::kUint16, 12);
  if (format.extended) {
    add_bits("return_number", 14, 0, 15);
    add_bits("number_of_returns", 14, 4, 15);
    add_bits("class_flags", 15, 0, 15);
    add_bits("scanner_channel", 15, 4, 3);
    add_bits("scan_direction_flag", 15, 6, 1);
    add_bits("edge_of_flight_line", 15, 7, 1);
    add_plain("classification", ScalarType::kUint8, 16);
    add_plain("user_data", ScalarType::kUint8, 17);
    Column angle;
    angle.kind = Column::Kind::kScaled;
    angle.offset = 18;
    angle.stored = ScalarType::kInt16;
    angle.scale = kLasAngleUnit;
    add("scan_angle", ScalarType::kFloat64, angle);
    add_plain("point_source_id", ScalarType::kUint16, 20);
  } else {
    add_bits("return_number", 14, 0, 7);
    add_bits("number_of_returns", 14, 3, 7);
    add_bits("scan_direction_flag", 14, 6, 1);
    add_bits("edge_of_flight_line", 14, 7, 1);
    add_bits("classification", 15, 0, 31);
    add_bits("class_flags", 15, 5, 7);
    add_plain("scan_angle_rank", ScalarType::kInt8, 16);
    add_plain("user_data", ScalarType::kUint8, 17);
    add_plain("point_source_id", ScalarType::kUint16, 18);
  }
  if (format.time >= 0) {
    add_plain("gps_time", ScalarType::kFloat64, static_cast<std::size_t>(format.time));
  }
  if (format.color >= 0) {
    const char* const channels[] = {"red", "green", "blue"};
    for (std::size_t c = 0; c < 3; ++c) {
      add_plain(channels[c], ScalarType::kUint16, static_cast<std::size_t>(format.color) + 2 * c);
    }
  }
  if (format.infrared >= 0) {
    add_plain("nir", ScalarType::kUint16, static_cast<std::size_t>(format.infrared));
  }
  if (format.wave >= 0) report_.notes.emplace_back("wave packets are not kept");
}

/// Columns of the extra bytes that are described.
void LasSource::add_extra_columns(const LasPointFormat& format) {
  const std::size_t extra_bytes = record_size_ - format.size;
  if (extra_bytes > kMostExtraBytes) {
    file_->fail_at(105, "found " + std::to_string(extra_bytes) +
                            " extra bytes a point, expected at most " +
                            std::to_string(kMostExtraBytes));
  }
  std::size_t described = 0;
  for (const Extra& extra : extras_) described += extra.size;
  if (described > extra_bytes) {
    if (!options_.lenient) {
      file_->fail_at(105, "found " + std::to_string(extra_bytes) +
                              " extra bytes a point, expected the " + std::to_string(described) +
                              " that are described");
    }
    report_.notes.emplace_back("the extra bytes do not fit their description and are not kept");
    return;
  }
  if (described < extra_bytes) {
    report_.notes.push_back(std::to_string(extra_bytes - described) +
                            " extra bytes a point without a description are not kept");
  }
  // An attribute that is described under the name of a standard one goes before it.
  for (const Extra& extra : extras_) {
    for (std::size_t f = 3; f < header_.fields.size(); ++f) {
      if (header_.fields[f].name != extra.name) continue;
      header_.fields.erase(header_.fields.begin() + static_cast<std::ptrdiff_t>(f));
      columns_.erase(columns_.begin() + static_cast<std::ptrdiff_t>(f));
      values_.pop_back();
      break;
    }
  }
  std::set<std::string> names;
  for (const PointField& field : header_.fields) names.insert(field.name);
  std::size_t offset = format.size;
  for (const Extra& extra : extras_) {
    const std::size_t elements =
        extra.type == 0 ? 0 : static_cast<std::size_t>((extra.type - 1) / 10 + 1);
    for (std::size_t k = 0; k < elements; ++k) {
      const ScalarType type = las_extra_type(extra.type);
      std::string name = extra.name.empty() ? "extra" : extra.name;
      if (elements > 1) name += "_" + std::to_string(k);
      while (!names.insert(name).second) name += "_";
      Column column;
      column.offset = offset + k * size_of(type);
      column.stored = type;
      column.kind = extra.scaled ? Column::Kind::kScaled : Column::Kind::kPlain;
      column.scale = extra.scale;
      column.shift_by = extra.offset;
      add(name, extra.scaled ? ScalarType::kFloat64 : type, column);
    }
    offset += extra.size;
  }
}

}  // namespace

std::unique_ptr<PointSource> open_las(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<LasSource>(std::move(file), options);
}

}  // namespace camber
