// LAS files, versions 1.0 to 1.4, point formats 0 to 10, uncompressed: the ASPRS specifications
// ("LAS Specification 1.4 - R15", 2019, and its predecessors).

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kRecordHeader = 54;         // bytes of a variable-length record's header
constexpr std::size_t kExtraDescription = 192;    // bytes of one description of extra bytes
constexpr std::size_t kMostExtraBytes = 1 << 14;  // a point
constexpr double kAngleUnit = 0.006;              // degrees, scan angles of formats 6 to 10

template <typename T>
T load(const unsigned char* data) {
  T value;
  std::memcpy(&value, data, sizeof value);
  return value;
}

/// Standard part of a point record.
struct PointFormat {
  std::size_t size = 0;
  bool extended = false;                                // formats 6 to 10
  int time = -1, color = -1, infrared = -1, wave = -1;  // offsets
};

PointFormat point_format(int id) {
  // Sizes and offsets from the tables of the specification.
  static const PointFormat kFormats[] = {
      {20, false, -1, -1, -1, -1}, {28, false, 20, -1, -1, -1}, {26, false, -1, 20, -1, -1},
      {34, false, 20, 28, -1, -1}, {57, false, 20, -1, -1, 28}, {63, false, 20, 28, -1, 34},
      {30, true, 22, -1, -1, -1},  {36, true, 22, 30, -1, -1},  {38, true, 22, 30, 36, -1},
      {59, true, 22, -1, -1, 30},  {67, true, 22, 30, 36, 38},
  };
  return kFormats[id];
}

/// What to take out of a record for one column.
struct Column {
  enum class Kind { kPlain, kCoordinate, kBits, kScaled } kind = Kind::kPlain;
  std::size_t offset = 0;
  ScalarType stored = ScalarType::kUint8;
  unsigned shift = 0, mask = 0xff;  // kBits, of one byte
  double scale = 1.0, shift_by = 0.0;
};

ScalarType extra_type(int id) {
  static const ScalarType kTypes[] = {
      ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16, ScalarType::kInt16,
      ScalarType::kUint32,  ScalarType::kInt32,  ScalarType::kUint64, ScalarType::kInt64,
      ScalarType::kFloat32, ScalarType::kFloat64};
  return kTypes[(id - 1) % 10];
}

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
  void lay_out(int format, std::size_t record_size);
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
  const PointFormat format = point_format(format_byte);
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
  lay_out(format_byte, record_size_);
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
    if (end - start < kRecordHeader || !file_->fill(kRecordHeader)) {
      return fail("found no room for record " + std::to_string(i + 1));
    }
    const unsigned char* const h = file_->data();
    const char* const user = reinterpret_cast<const char*>(h + 2);
    const std::string user_id(user,
                              static_cast<std::size_t>(std::find(user, user + 16, '\0') - user));
    const std::uint16_t id = load<std::uint16_t>(h + 18);
    const std::uint16_t length = load<std::uint16_t>(h + 20);
    if (length > end - start - kRecordHeader) {
      return fail("found record " + std::to_string(i + 1) + " with " + std::to_string(length) +
                  " bytes that reach into the points");
    }
    file_->consume(kRecordHeader);
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
  for (std::size_t at = 0; at + kExtraDescription <= size; at += kExtraDescription) {
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
      extra.size = elements * size_of(extra_type(extra.type));
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

void LasSource::lay_out(int format_id, std::size_t record_size) {
  const PointFormat format = point_format(format_id);
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
    angle.scale = kAngleUnit;
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

  const std::size_t extra_bytes = record_size - format.size;
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
      const ScalarType type = extra_type(extra.type);
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

// --- writing -----------------------------------------------------------------------------------

void store(std::string& out, std::size_t at, const void* data, std::size_t size) {
  std::memcpy(out.data() + at, data, size);
}
template <typename T>
void store(std::string& out, std::size_t at, T value) {
  store(out, at, &value, sizeof value);
}

class LasSink : public PointSink {
 public:
  LasSink(std::ostream& out, const PointStreamHeader& header) : out_(out), header_(header) {
    const FieldRoles roles = find_roles(header.fields);
    position_ = roles.position;
    color_ = roles.color;
    packed_ = roles.packed_color;
    std::vector<bool> standard(header.fields.size(), false);
    const auto find = [&](const char* name) {
      for (std::size_t f = 0; f < header.fields.size(); ++f) {
        if (header.fields[f].name == name) {
          standard[f] = true;
          return static_cast<int>(f);
        }
      }
      return -1;
    };
    intensity_ = find("intensity");
    return_number_ = find("return_number");
    number_of_returns_ = find("number_of_returns");
    class_flags_ = find("class_flags");
    channel_ = find("scanner_channel");
    direction_ = find("scan_direction_flag");
    edge_ = find("edge_of_flight_line");
    classification_ = find("classification");
    user_data_ = find("user_data");
    angle_ = find("scan_angle");
    angle_rank_ = find("scan_angle_rank");
    source_id_ = find("point_source_id");
    time_ = find("gps_time");
    infrared_ = find("nir");
    // An intensity in other units is kept as it is, beside the standard field.
    if (intensity_ >= 0 && is_float(type(intensity_))) {
      standard[static_cast<std::size_t>(intensity_)] = false;
      intensity_ = -1;
    }
    for (const int f : position_) mark(standard, f);
    for (const int f : color_) mark(standard, f);
    mark(standard, packed_);
    const bool has_color = color_[0] >= 0 || packed_ >= 0;
    const bool extended =
        angle_ >= 0 || channel_ >= 0 || infrared_ >= 0 || (classification_ >= 0 && angle_rank_ < 0);
    format_id_ = extended ? (infrared_ >= 0 ? 8
                             : has_color    ? 7
                                            : 6)
                          : (time_ >= 0 ? 1 : 0) + (has_color ? 2 : 0);
    format_ = point_format(format_id_);
    record_size_ = format_.size;
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      if (standard[f]) continue;
      extras_.push_back(static_cast<int>(f));
      record_size_ += size_of(header.fields[f].type);
    }
    if (record_size_ > UINT16_MAX || extras_.size() > 341) {
      throw std::invalid_argument("the cloud has " + std::to_string(extras_.size()) +
                                  " further attributes, expected fewer for LAS");
    }
    minor_ = extended || !extras_.empty() || header.count.value_or(UINT64_MAX) > UINT32_MAX ? 4 : 2;
    start_ = out.tellp();
    if (header.grid) {
      scale_ = header.grid->scale;
      offset_ = header.grid->offset;
      grid_set_ = true;
    }
    write_head();
  }

  void write(const PointBatch& batch) override {
    if (!grid_set_) choose_grid(batch);
    text_.assign(batch.count * record_size_, '\0');
    for (std::size_t i = 0; i < batch.count; ++i) pack(batch, i, i * record_size_);
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
    count_ += batch.count;
  }

  void finish() override {
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    write_head();
    out_.seekp(end);
  }

 private:
  static void mark(std::vector<bool>& standard, int field) {
    if (field >= 0) standard[static_cast<std::size_t>(field)] = true;
  }
  ScalarType type(int field) const { return header_.fields[static_cast<std::size_t>(field)].type; }
  double value(const PointBatch& batch, int field, std::size_t i, double otherwise = 0.0) const {
    return field < 0 ? otherwise
                     : batch.fields[static_cast<std::size_t>(field)].number(type(field), i);
  }
  double clamped(const PointBatch& batch, int field, std::size_t i, double largest,
                 double otherwise = 0.0) const {
    const double v = value(batch, field, i, otherwise);
    return v > 0.0 ? std::min(std::floor(v + 0.5), largest) : 0.0;
  }

  void choose_grid(const PointBatch& batch) {
    grid_set_ = true;
    scale_ = Eigen::Vector3d::Constant(1e-4);  // m: +-214 km around the offset
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      if (header_.origin) {
        offset_[a] = (*header_.origin)[a];
        continue;
      }
      const double first = batch.count > 0 ? value(batch, position_[axis], 0) : 0.0;
      offset_[a] =
          std::abs(first) > 1e5 && std::isfinite(first) ? std::round(first / 1e3) * 1e3 : 0.0;
    }
  }

  void pack(const PointBatch& batch, std::size_t i, std::size_t at) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      const double x = value(batch, position_[axis], i);
      const double steps = std::round((x - offset_[a]) / scale_[a]);
      if (!(std::abs(steps) <= 2147483647.0)) {
        std::string shown_value;
        append_number(shown_value, x);
        throw std::invalid_argument(
            "point " + std::to_string(count_ + i) + " has the coordinate " + shown_value +
            ", expected a finite one within 214 km of the others for LAS (--lenient drops points "
            "that are not finite)");
      }
      store(text_, at + 4 * axis, static_cast<std::int32_t>(steps));
      const double kept = steps * scale_[a] + offset_[a];
      if (count_ + i == 0 || kept < low_[a]) low_[a] = kept;
      if (count_ + i == 0 || kept > high_[a]) high_[a] = kept;
    }
    store(text_, at + 12, static_cast<std::uint16_t>(clamped(batch, intensity_, i, 65535.0)));
    const unsigned most_returns = format_.extended ? 15 : 7;
    const unsigned number =
        static_cast<unsigned>(clamped(batch, return_number_, i, most_returns, 1.0));
    const unsigned returns =
        static_cast<unsigned>(clamped(batch, number_of_returns_, i, most_returns, 1.0));
    ++by_return_[number > 0 ? number - 1 : 0];
    const unsigned direction = static_cast<unsigned>(clamped(batch, direction_, i, 1.0));
    const unsigned edge = static_cast<unsigned>(clamped(batch, edge_, i, 1.0));
    if (format_.extended) {
      text_[at + 14] = static_cast<char>(number | returns << 4);
      text_[at + 15] =
          static_cast<char>(static_cast<unsigned>(clamped(batch, class_flags_, i, 15.0)) |
                            static_cast<unsigned>(clamped(batch, channel_, i, 3.0)) << 4 |
                            direction << 6 | edge << 7);
      text_[at + 16] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, classification_, i, 255.0)));
      text_[at + 17] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, user_data_, i, 255.0)));
      const double degrees = angle_ >= 0 ? value(batch, angle_, i) : value(batch, angle_rank_, i);
      const double units = std::isfinite(degrees)
                               ? std::clamp(std::round(degrees / kAngleUnit), -30000.0, 30000.0)
                               : 0.0;
      store(text_, at + 18, static_cast<std::int16_t>(units));
      store(text_, at + 20, static_cast<std::uint16_t>(clamped(batch, source_id_, i, 65535.0)));
    } else {
      text_[at + 14] = static_cast<char>(number | returns << 3 | direction << 6 | edge << 7);
      text_[at + 15] =
          static_cast<char>(static_cast<unsigned>(clamped(batch, classification_, i, 31.0)) |
                            static_cast<unsigned>(clamped(batch, class_flags_, i, 7.0)) << 5);
      const double rank = value(batch, angle_rank_, i);
      text_[at + 16] = static_cast<char>(
          static_cast<std::int8_t>(std::isfinite(rank) ? std::clamp(rank, -128.0, 127.0) : 0.0));
      text_[at + 17] =
          static_cast<char>(static_cast<std::uint8_t>(clamped(batch, user_data_, i, 255.0)));
      store(text_, at + 18, static_cast<std::uint16_t>(clamped(batch, source_id_, i, 65535.0)));
    }
    if (format_.time >= 0)
      store(text_, at + static_cast<std::size_t>(format_.time), value(batch, time_, i));
    if (format_.color >= 0) {
      for (std::size_t c = 0; c < 3; ++c) {
        store(text_, at + static_cast<std::size_t>(format_.color) + 2 * c,
              color_value(batch, c, i));
      }
    }
    if (format_.infrared >= 0) {
      store(text_, at + static_cast<std::size_t>(format_.infrared),
            static_cast<std::uint16_t>(clamped(batch, infrared_, i, 65535.0)));
    }
    std::size_t extra_at = at + format_.size;
    for (const int field : extras_) {
      const std::size_t size = size_of(type(field));
      const FieldView view = batch.fields[static_cast<std::size_t>(field)];
      store(text_, extra_at, view.data + i * view.stride, size);
      extra_at += size;
    }
  }

  /// 16 bits a channel; 8-bit values fill them.
  std::uint16_t color_value(const PointBatch& batch, std::size_t channel, std::size_t i) const {
    if (packed_ >= 0) {
      const std::uint32_t rgb =
          batch.fields[static_cast<std::size_t>(packed_)].get<std::uint32_t>(i);
      return static_cast<std::uint16_t>((rgb >> (16 - 8 * channel) & 255u) * 257u);
    }
    const int field = color_[channel];
    if (size_of(type(field)) == 1) {
      return static_cast<std::uint16_t>(
          batch.fields[static_cast<std::size_t>(field)].get<std::uint8_t>(i) * 257u);
    }
    const double v = value(batch, field, i);
    const double scaled = is_float(type(field)) && v <= 1.0 ? v * 65535.0 : v;
    return static_cast<std::uint16_t>(scaled > 0.0 ? std::min(scaled + 0.5, 65535.0) : 0.0);
  }

  std::string record(const char* user, std::uint16_t id, const char* description,
                     const std::string& content) const {
    std::string out(kRecordHeader, '\0');
    store(out, 2, user, std::strlen(user));
    store(out, 18, id);
    store(out, 20, static_cast<std::uint16_t>(content.size()));
    store(out, 22, description, std::strlen(description));
    return out + content;
  }

  std::string describe_extras() const {
    std::string out;
    for (const int field : extras_) {
      std::string d(kExtraDescription, '\0');
      const PointField& f = header_.fields[static_cast<std::size_t>(field)];
      for (int id = 1; id <= 10; ++id) {
        if (extra_type(id) == f.type) d[2] = static_cast<char>(id);
      }
      const std::string name = f.name.substr(0, 31);
      store(d, 4, name.data(), name.size());
      out += d;
    }
    return out;
  }

  void write_head() {
    std::string records;
    std::uint32_t record_count = 0;
    std::string comments;
    for (const std::string& comment : camber_comments(header_)) comments += comment + "\n";
    if (!comments.empty()) {
      records += record("Camber", 1, "frame of the coordinates", comments);
      ++record_count;
    }
    if (!extras_.empty()) {
      records += record("LASF_Spec", 4, "extra bytes", describe_extras());
      ++record_count;
    }
    const std::size_t header_size = minor_ == 4 ? 375 : 227;
    std::string h(header_size, '\0');
    store(h, 0, "LASF", 4);
    h[24] = 1;
    h[25] = static_cast<char>(minor_);
    store(h, 26, "Camber", 6);
    store(h, 58, "Camber", 6);
    // Formats 6 and later ask for coordinates in well-known text; there are none to give.
    store(h, 6, static_cast<std::uint16_t>(format_.extended ? 16 : 0));
    store(h, 94, static_cast<std::uint16_t>(header_size));
    store(h, 96, static_cast<std::uint32_t>(header_size + records.size()));
    store(h, 100, record_count);
    h[104] = static_cast<char>(format_id_);
    store(h, 105, static_cast<std::uint16_t>(record_size_));
    const bool old_counts = !format_.extended && count_ <= UINT32_MAX;
    if (minor_ < 4 && count_ > UINT32_MAX) {
      throw std::invalid_argument("the cloud has more points than LAS 1.2 can hold");
    }
    if (old_counts) {
      store(h, 107, static_cast<std::uint32_t>(count_));
      for (std::size_t r = 0; r < 5; ++r) {
        store(h, 111 + 4 * r, static_cast<std::uint32_t>(by_return_[r]));
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Eigen::Index a = static_cast<Eigen::Index>(axis);
      store(h, 131 + 8 * axis, scale_[a]);
      store(h, 155 + 8 * axis, offset_[a]);
      store(h, 179 + 16 * axis, high_[a]);
      store(h, 187 + 16 * axis, low_[a]);
    }
    if (minor_ == 4) {
      store(h, 247, count_);
      for (std::size_t r = 0; r < 15; ++r) store(h, 255 + 8 * r, by_return_[r]);
    }
    out_.write(h.data(), static_cast<std::streamsize>(h.size()));
    out_.write(records.data(), static_cast<std::streamsize>(records.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  std::array<int, 3> position_, color_;
  int packed_ = -1, intensity_ = -1, return_number_ = -1, number_of_returns_ = -1,
      class_flags_ = -1, channel_ = -1, direction_ = -1, edge_ = -1, classification_ = -1,
      user_data_ = -1, angle_ = -1, angle_rank_ = -1, source_id_ = -1, time_ = -1, infrared_ = -1;
  std::vector<int> extras_;
  int format_id_ = 0, minor_ = 2;
  PointFormat format_;
  std::size_t record_size_ = 0;
  Eigen::Vector3d scale_{1e-4, 1e-4, 1e-4}, offset_{0, 0, 0};
  Eigen::Vector3d low_{0, 0, 0}, high_{0, 0, 0};
  bool grid_set_ = false;
  std::array<std::uint64_t, 15> by_return_{};
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
  std::string text_;
};

}  // namespace

std::unique_ptr<PointSource> open_las(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<LasSource>(std::move(file), options);
}

std::unique_ptr<PointSink> make_las_sink(std::ostream& out, const PointStreamHeader& header) {
  return std::make_unique<LasSink>(out, header);
}

}  // namespace camber
