#include "camber/cloud/formats.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "camber/cloud/number_text.h"

namespace camber {

namespace {
constexpr std::size_t kLongestWkt = 1 << 14;  // bytes; longer ones are neither written nor read
}

// --- FormatSource ------------------------------------------------------------------------------

void FormatSource::read_comment(std::string_view comment) {
  if (next_word(comment) != "camber") return;
  const std::string_view key = next_word(comment);
  if (key == "frame") {
    const std::string_view frame = next_word(comment);
    if (frame == "camera") header_.frame = CloudFrame::kCamera;
    if (frame == "z-up") header_.frame = CloudFrame::kZUp;
  } else if (key == "metric") {
    header_.metric = next_word(comment) != "false";
  } else if (key == "origin") {
    Eigen::Vector3d origin;
    for (int axis = 0; axis < 3; ++axis) {
      const std::string_view word = next_word(comment);
      const ParsedNumber number = parse_number(word.data(), word.data() + word.size());
      if (word.empty() || number.end != word.data() + word.size() || !std::isfinite(number.value)) {
        lines_.fail("found " + shown(word) + " in 'camber origin', expected three finite numbers");
      }
      origin[axis] = number.value;
    }
    header_.origin = origin;
  } else if (!options_.crs) {
    read_crs_comment(key, comment);
  }
}

void FormatSource::read_crs_comment(std::string_view key, std::string_view rest) {
  if (key == "crs" || key == "crs+") {
    if (key == "crs") crs_text_.clear();
    rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
    if (key == "crs+" && (rest.empty() || crs_text_.size() + rest.size() > kLongestWkt)) return;
    crs_text_ += rest;
    CoordinateSystem crs = coordinate_system_from_wkt(crs_text_);
    std::string_view word = next_word(rest);
    std::uint64_t code = 0;
    if (key == "crs" && word.substr(0, 5) == "EPSG:" && parse_unsigned(word.substr(5), code) &&
        code < 1000000) {
      crs = coordinate_system_from_epsg(static_cast<int>(code));
    }
    if (crs.kind != CoordinateSystem::Kind::kUnknown || crs.epsg > 0) take_crs(crs);
  } else if (key == "unit") {
    double metres[2];
    for (double& value : metres) {
      const std::string_view word = next_word(rest);
      const ParsedNumber number = parse_number(word.data(), word.data() + word.size());
      const bool good = !word.empty() && number.end == word.data() + word.size() &&
                        std::isfinite(number.value) && number.value > 0.0;
      if (!good) {
        lines_.fail("found " + shown(word) + " in 'camber unit', expected two lengths in metres");
      }
      value = number.value;
    }
    CoordinateSystem crs = header_.crs.value_or(CoordinateSystem());
    crs.horizontal = unit_from_metres(metres[0]);
    crs.vertical = unit_from_metres(metres[1]);
    crs.vertical_stated = true;
    take_crs(crs);
  }
}

void FormatSource::take_crs(const CoordinateSystem& of_file) {
  const CoordinateSystem& crs = options_.crs ? *options_.crs : of_file;
  if (!crs.stated() && !crs.horizontal.known() && crs.epsg == 0) return;
  header_.crs = crs;
  if (!crs.metric()) header_.metric = false;
}

void FormatSource::check_fields(const std::string& position) {
  const FieldRoles roles = find_roles(header_.fields);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    if (roles.position[axis] < 0) {
      throw InputError(file_->name(), position,
                       std::string("found no field '") + "xy"[axis] + "', expected x, y and z");
    }
  }
  if (roles.position[2] < 0) report_.notes.push_back("there is no field 'z'; all z are 0");
}

std::uint64_t FormatSource::check_count(std::uint64_t count, std::uint64_t bytes,
                                        std::uint64_t rest, const std::string& what) {
  const std::uint64_t fitting = rest / bytes;
  if (count <= fitting) return count;
  if (!options_.lenient) {
    file_->fail_at(file_->size(), "found the end of the file after at most " +
                                      std::to_string(fitting) + " " + what + ", expected " +
                                      std::to_string(count));
  }
  return fitting;
}

// --- RecordReader ------------------------------------------------------------------------------

RecordReader::RecordReader(std::size_t record_size, std::vector<Field> fields, std::uint64_t count,
                           bool swap)
    : record_size_(record_size), fields_(std::move(fields)), left_(count), swap_(swap) {}

namespace {
std::uint16_t swapped(std::uint16_t v) { return __builtin_bswap16(v); }
std::uint32_t swapped(std::uint32_t v) { return __builtin_bswap32(v); }
std::uint64_t swapped(std::uint64_t v) { return __builtin_bswap64(v); }

template <typename T>
void swap_column(unsigned char* value, std::size_t stride, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i, value += stride) {
    T number;
    std::memcpy(&number, value, sizeof number);
    number = swapped(number);
    std::memcpy(value, &number, sizeof number);
  }
}
}  // namespace

bool RecordReader::next(FileReader& file, PointBatch& batch) {
  file.consume(pending_);
  pending_ = 0;
  batch.count = 0;
  if (left_ == 0) return false;
  file.fill(record_size_);
  const std::size_t count = static_cast<std::size_t>(std::min<std::uint64_t>(
      std::min<std::uint64_t>(left_, kBatchSize), file.available() / record_size_));
  const unsigned char* data = file.data();
  pending_ = count * record_size_;
  left_ -= count;
  if (swap_) {
    swapped_.assign(data, data + pending_);
    for (const Field& field : fields_) {
      unsigned char* const first = swapped_.data() + field.offset;
      switch (size_of(field.type)) {
        case 2:
          swap_column<std::uint16_t>(first, record_size_, count);
          break;
        case 4:
          swap_column<std::uint32_t>(first, record_size_, count);
          break;
        case 8:
          swap_column<std::uint64_t>(first, record_size_, count);
          break;
        default:
          break;
      }
    }
    data = swapped_.data();
  }
  batch.count = count;
  batch.fields.clear();
  for (const Field& field : fields_) batch.fields.push_back({data + field.offset, record_size_});
  return true;
}

// --- text rows ---------------------------------------------------------------------------------

namespace {

/// A value that has been checked against the range of T; the double next to the largest 64-bit
/// integers lies just outside of it.
template <typename T>
T narrow(double value) {
  if constexpr (std::is_integral_v<T> && sizeof(T) == 8) {
    if (value >= static_cast<double>(std::numeric_limits<T>::max())) {
      return std::numeric_limits<T>::max();
    }
  }
  return static_cast<T>(value);
}

}  // namespace

void RowBuffer::start(std::vector<ScalarType> types) {
  types_ = std::move(types);
  columns_.assign(types_.size(), {});
  rows_ = 0;
  grow();
}

void RowBuffer::grow() {
  values_.resize(types_.size() * std::min(kRows, std::max<std::size_t>(16, 2 * rows_)));
}

void RowBuffer::fill(PointBatch& batch) {
  batch.count = rows_;
  batch.fields.clear();
  const std::size_t width = types_.size();
  for (std::size_t c = 0; c < width; ++c) {
    if (types_[c] == ScalarType::kFloat64) {
      batch.fields.push_back(
          {reinterpret_cast<const unsigned char*>(values_.data() + c), width * sizeof(double)});
      continue;
    }
    std::vector<unsigned char>& column = columns_[c];
    with_type(types_[c], [&](auto tag) {
      using T = decltype(tag);
      column.resize(rows_ * sizeof(T));
      for (std::size_t i = 0; i < rows_; ++i) {
        const T value = narrow<T>(values_[i * width + c]);
        std::memcpy(column.data() + i * sizeof(T), &value, sizeof(T));
      }
      batch.fields.push_back({column.data(), sizeof(T)});
    });
  }
}

bool has_large_values(const RowBuffer& rows, int column) {
  constexpr double kLarge = 1000.0;  // m; a float resolves 0.06 mm there
  for (std::size_t i = 0; column >= 0 && i < rows.rows(); ++i) {
    if (std::abs(rows.row(i)[column]) >= kLarge) return true;
  }
  return false;
}

namespace {

/// Smallest and largest value of an integer type as doubles that are exact.
bool in_range(ScalarType type, double value) {
  switch (type) {
    case ScalarType::kInt8:
      return value >= -128.0 && value <= 127.0;
    case ScalarType::kUint8:
      return value >= 0.0 && value <= 255.0;
    case ScalarType::kInt16:
      return value >= -32768.0 && value <= 32767.0;
    case ScalarType::kUint16:
      return value >= 0.0 && value <= 65535.0;
    case ScalarType::kInt32:
      return value >= -2147483648.0 && value <= 2147483647.0;
    case ScalarType::kUint32:
      return value >= 0.0 && value <= 4294967295.0;
    case ScalarType::kInt64:
      return value >= -0x1p63 && value <= 0x1p63;
    case ScalarType::kUint64:
      return value >= 0.0 && value <= 0x1p64;
    case ScalarType::kFloat32:
    case ScalarType::kFloat64:
      break;
  }
  return true;
}

}  // namespace

std::string parse_row(std::string_view line, const std::vector<ColumnRule>& rules, char separator,
                      double* row, std::vector<unsigned char>* fractional) {
  const char* p = line.data();
  const char* const end = p + line.size();
  const auto skip_blanks = [&] {
    while (p < end && is_blank(*p)) ++p;
  };
  const bool separated = separator != ' ';
  std::size_t found = 0;
  bool open = false;  // behind a separator, where a value is missing if none follows
  skip_blanks();
  while (p < end || open) {
    if (found == rules.size()) {
      return "found more than " + std::to_string(found) + " values, expected " +
             std::to_string(found);
    }
    const ColumnRule& rule = rules[found];
    const bool quoted = separated && p < end && *p == '"';
    if (rule.column < 0 && fractional != nullptr) {
      // A column that is skipped may hold words.
      for (bool within = false; p < end; ++p) {
        if (separated && *p == '"') within = !within;
        if (!within && (separated ? *p == separator : is_blank(*p))) break;
      }
    } else if (separated && (p == end || *p == separator)) {
      if (!is_float(rule.type)) return "found no value, expected a whole number";
      if (rule.packed_color) return "found no value, expected a colour";
      if (rule.column >= 0) row[rule.column] = std::numeric_limits<double>::quiet_NaN();
      if (fractional != nullptr && rule.column >= 0)
        (*fractional)[static_cast<std::size_t>(rule.column)] = 1;
    } else {
      if (quoted) ++p;
      const ParsedNumber number = parse_number(p, end);
      const char* behind = number.end;
      if (quoted && behind != nullptr)
        behind = behind < end && *behind == '"' ? behind + 1 : nullptr;
      if (behind == nullptr ||
          (behind < end && !is_blank(*behind) && !(separated && *behind == separator))) {
        std::string_view rest(p, static_cast<std::size_t>(end - p));
        return "found " + shown(next_word(rest)) + ", expected a number";
      }
      double value = number.value;
      if (!is_float(rule.type)) {
        const std::string_view text(p, static_cast<std::size_t>(number.end - p));
        if (!(std::isfinite(value) && std::floor(value) == value)) {
          return "found " + shown(text) + ", expected a whole number";
        }
        if (!in_range(rule.type, value)) {
          return "found " + shown(text) + ", expected a number in the range of its integer type";
        }
      } else if (rule.packed_color && !(number.whole && value >= 0.0 && value <= 4294967295.0)) {
        const float bits = static_cast<float>(value);
        std::uint32_t packed = 0;
        std::memcpy(&packed, &bits, 4);
        value = packed;
      }
      if (rule.column >= 0) {
        row[rule.column] = value;
        if (fractional != nullptr && !number.whole) {
          (*fractional)[static_cast<std::size_t>(rule.column)] = 1;
        }
      }
      p = behind;
    }
    ++found;
    skip_blanks();
    open = false;
    if (separated && p < end && *p == separator) {
      ++p;
      skip_blanks();
      open = true;
    }
  }
  if (found < rules.size()) {
    return "found " + std::to_string(found) + " values, expected " + std::to_string(rules.size());
  }
  return {};
}

// --- writing -----------------------------------------------------------------------------------

namespace {

/// Readers of PLY hold a line in 1,024 bytes; some of them end the program at a longer one.
constexpr std::size_t kLongestComment = 900;

/// "camber crs TEXT"; what does not fit on a line follows on lines "camber crs+ TEXT".
void add_crs_comments(std::string text, std::vector<std::string>* comments) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20) c = ' ';
  }
  const char* key = "camber crs ";
  while (!text.empty()) {
    std::size_t length = std::min(text.size(), kLongestComment);
    // Not beside a blank, which a reader may strip, nor within a character, where there is such a
    // place.
    for (std::size_t at = length; length < text.size() && at > length / 2; --at) {
      if (text[at - 1] == ' ' || text[at] == ' ' || (text[at] & 0xc0) == 0x80) continue;
      length = at;
      break;
    }
    comments->push_back(key + text.substr(0, length));
    text.erase(0, length);
    key = "camber crs+ ";
  }
}

}  // namespace

std::vector<std::string> camber_comments(const PointStreamHeader& header) {
  std::vector<std::string> comments;
  if (header.frame == CloudFrame::kCamera) comments.emplace_back("camber frame camera");
  if (header.frame == CloudFrame::kZUp) comments.emplace_back("camber frame z-up");
  if (!header.metric) comments.emplace_back("camber metric false");
  if (header.origin) {
    std::string line = "camber origin";
    for (int axis = 0; axis < 3; ++axis) {
      line += ' ';
      append_number(line, (*header.origin)[axis]);
    }
    comments.push_back(line);
  }
  if (!header.crs) return comments;
  const CoordinateSystem& crs = *header.crs;
  if (!crs.wkt.empty() && crs.wkt.size() <= kLongestWkt) {
    add_crs_comments(crs.wkt, &comments);
  } else if (crs.epsg > 0) {
    comments.push_back("camber crs EPSG:" + std::to_string(crs.epsg));
  }
  if (!crs.metric() && !crs.horizontal.angle && !crs.vertical.angle) {
    std::string line = "camber unit ";
    append_number(line, crs.horizontal.metres);
    line += ' ';
    append_number(line, crs.vertical.metres);
    comments.push_back(line);
  }
  return comments;
}

void make_names_unique(std::vector<ColumnName>& names, std::string_view others,
                       std::vector<std::string>* notes) {
  std::vector<std::string> clean;
  std::vector<int> turn;
  for (const ColumnName& column : names) {
    std::string name = column.name;
    for (char& c : name) {
      if (is_blank(c) || c == '\n' || others.find(c) != std::string_view::npos) c = '_';
    }
    turn.push_back(column.fixed ? 0 : name == column.name ? 1 : 2);
    clean.push_back(std::move(name));
  }
  std::set<std::string> taken;
  for (const int now : {0, 1, 2}) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (turn[i] != now) continue;
      std::string name = clean[i];
      while (!taken.insert(name).second) name += '_';
      if (name != clean[i]) {
        notes->push_back("the attribute '" + names[i].name + "' is written as '" + name +
                         "', since another one is '" + clean[i] + "'");
      }
      names[i].name = name;
    }
  }
}

bool may_be_angles(const PointStreamHeader& header) {
  if (!header.crs) return false;
  const CoordinateSystem& crs = *header.crs;
  return crs.kind == CoordinateSystem::Kind::kGeographic || crs.horizontal.angle ||
         (crs.epsg > 0 && !crs.horizontal.known());
}

bool floats_hold_coordinates(const PointStreamHeader& header) {
  constexpr double kFar = 8192.0;  // m
  if (!header.bounds || may_be_angles(header)) return false;
  const double metres =
      header.crs ? std::max(header.crs->horizontal.metres, header.crs->vertical.metres) : 1.0;
  const double greatest = (-header.bounds->min()).cwiseMax(header.bounds->max()).maxCoeff();
  return greatest * metres < kFar;
}

ColorBytes::ColorBytes(const PointStreamHeader& header)
    : fields_(header.fields),
      color_(find_roles(header.fields).color),
      bytes_(full_color_by_type(header.fields) == 255.0),
      full_(header.full_color) {}

const std::vector<std::array<std::uint8_t, 3>>& ColorBytes::convert(const PointBatch& batch) {
  if (!bytes_ && !full_) {
    GreatestColor greatest(fields_);
    greatest.add(batch);
    full_ = greatest.full_color();
  }
  out_.resize(batch.count);
  for (std::size_t c = 0; c < 3; ++c) {
    const auto field = static_cast<std::size_t>(color_[c]);
    const FieldView& view = batch.fields[field];
    for (std::size_t i = 0; i < batch.count; ++i) {
      if (bytes_) {
        out_[i][c] = view.get<std::uint8_t>(i);
        continue;
      }
      const double value = view.number(fields_[field].type, i);
      out_[i][c] = color_byte(value, *full_);
      // Bytes that were scaled to 16 bits come back as they were.
      less_ = less_ || (*full_ > 255.0 && value > 0.0 && std::fmod(value, 256.0) != 0.0 &&
                        std::fmod(value, 257.0) != 0.0);
    }
  }
  return out_;
}

void ColorBytes::add_note(std::vector<std::string>* notes) const {
  if (less_) notes->emplace_back("the colours have 8 bits a channel, of 16 in the input");
}

void append_value(std::string& out, const FieldView& view, ScalarType type, std::size_t i) {
  with_type(type, [&](auto tag) {
    using T = decltype(tag);
    const T value = view.get<T>(i);
    if constexpr (std::is_floating_point_v<T>) {
      append_number(out, value);
    } else if constexpr (std::is_signed_v<T>) {
      append_number(out, static_cast<std::int64_t>(value));
    } else {
      append_number(out, static_cast<std::uint64_t>(value));
    }
  });
}

void pack_records(const PointBatch& batch, const std::vector<PointField>& fields, bool swap,
                  std::string& out) {
  std::size_t record_size = 0;
  for (const PointField& field : fields) record_size += size_of(field.type);
  const std::size_t old = out.size();
  out.resize(old + batch.count * record_size);
  char* base = out.data() + old;
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const FieldView view = batch.fields[f];
    with_type(fields[f].type, [&](auto tag) {
      constexpr std::size_t kSize = sizeof(tag);
      char* to = base;
      for (std::size_t i = 0; i < batch.count; ++i, to += record_size) {
        std::memcpy(to, view.data + i * view.stride, kSize);
        if (swap) std::reverse(to, to + kSize);
      }
      base += kSize;
    });
  }
}

}  // namespace camber
