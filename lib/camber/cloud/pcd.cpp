// PCD files: http://pointclouds.org/documentation/tutorials/pcd_file_format.html, and what PCL's
// own writer does beyond it (padding behind the points, the packed rgb field).

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "camber/cloud/formats.h"
#include "camber/cloud/lzf.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kHeaderLine = 1 << 16;  // bytes
constexpr std::size_t kMostFields = 4096;     // columns, all elements of all fields
constexpr std::size_t kMostRowValues = 1 << 16;
constexpr std::uint64_t kMostElements = 64;  // a field of more is a descriptor and is not kept

struct PcdField {
  std::string name;
  std::uint64_t size = 4;
  char type = 'F';
  std::uint64_t count = 1;
  bool kept = true;
};

std::optional<ScalarType> scalar_type(char type, std::uint64_t size) {
  switch (type) {
    case 'F':
      if (size == 4) return ScalarType::kFloat32;
      if (size == 8) return ScalarType::kFloat64;
      break;
    case 'I':
      if (size == 1) return ScalarType::kInt8;
      if (size == 2) return ScalarType::kInt16;
      if (size == 4) return ScalarType::kInt32;
      if (size == 8) return ScalarType::kInt64;
      break;
    case 'U':
      if (size == 1) return ScalarType::kUint8;
      if (size == 2) return ScalarType::kUint16;
      if (size == 4) return ScalarType::kUint32;
      if (size == 8) return ScalarType::kUint64;
      break;
    default:
      break;
  }
  return std::nullopt;
}

class PcdSource : public FormatSource {
 public:
  PcdSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kPcd;
    read_header();
    start_body();
  }

  bool next(PointBatch& batch) override {
    bool more = false;
    switch (body_) {
      case Body::kAscii:
        more = next_ascii(batch);
        break;
      case Body::kBinary:
        more = next_binary(batch);
        break;
      case Body::kCompressed:
        more = next_compressed(batch);
        break;
    }
    report_.points += batch.count;
    return more;
  }

 private:
  enum class Body { kAscii, kBinary, kCompressed };

  std::vector<std::string_view> words(std::string_view line) {
    std::vector<std::string_view> out;
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line)) {
      out.push_back(word);
    }
    return out;
  }

  std::uint64_t number(const std::vector<std::string_view>& values, const char* key) {
    std::uint64_t value = 0;
    if (values.size() != 1 || !parse_unsigned(values[0], value)) {
      lines_.fail(std::string("found ") + (values.empty() ? "nothing" : shown(values[0])) +
                  " after " + key + ", expected one whole number");
    }
    return value;
  }

  /// One value a field after a key of the header.
  void expect_one_each(const std::vector<std::string_view>& values, const char* key) {
    if (fields_.empty()) lines_.fail(std::string("found ") + key + ", expected FIELDS before it");
    if (values.size() != fields_.size()) {
      lines_.fail("found " + std::to_string(values.size()) + " values after " + key +
                  ", expected one for each of " + std::to_string(fields_.size()) + " fields");
    }
  }

  void read_header();
  void lay_out();
  void start_body();
  bool next_ascii(PointBatch& batch);
  bool next_binary(PointBatch& batch);
  bool next_compressed(PointBatch& batch);
  void check_padding();
  void read_rows();

  std::vector<PcdField> fields_;
  std::uint64_t points_ = 0;
  std::uint64_t record_size_ = 0;   // with padding fields
  std::uint64_t padding_size_ = 0;  // of the fields named "_"
  std::uint64_t values_per_row_ = 0;
  Body body_ = Body::kAscii;
  std::vector<RecordReader::Field> places_;  // of the kept columns in a record
  RecordReader records_;
  RowBuffer rows_;
  bool rows_pending_ = false;      // the first rows are read with the header
  std::vector<ColumnRule> rules_;  // of all values of an ASCII row
  std::uint64_t rows_done_ = 0;
  std::vector<unsigned char> columns_;  // decompressed
  std::vector<std::size_t> column_start_, column_stride_;
  bool commas_noted_ = false;
  bool tail_checked_ = false;
};

void PcdSource::read_header() {
  std::optional<std::uint64_t> width, height, points;
  bool sizes_seen = false, types_seen = false;
  std::set<std::string> seen;
  std::string_view line;
  while (true) {
    if (!lines_.next(line, kHeaderLine)) {
      file_->fail_at(file_->size(),
                     "found the end of the file, expected a DATA line of a PCD header");
    }
    if (file_->position() > (std::uint64_t{1} << 24)) {
      lines_.fail("found a header of more than 16 MB, expected a DATA line before");
    }
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    if (word.empty()) continue;
    if (word[0] == '#') {
      std::string_view comment = line.substr(line.find('#') + 1);
      read_comment(comment);
      continue;
    }
    const std::string key = lower_case(word);
    const std::vector<std::string_view> values = words(rest);
    if (key != "version" && key != "fields" && key != "columns" && key != "size" && key != "type" &&
        key != "count" && key != "width" && key != "height" && key != "viewpoint" &&
        key != "points" && key != "data") {
      if (seen.empty()) {
        lines_.fail("found " + shown(line) +
                    ", expected a PCD header (VERSION, FIELDS, ...); a file of bare numbers can be "
                    "read as text");
      }
      lines_.fail("found " + shown(word) + ", expected a keyword of a PCD header");
    }
    if (!seen.insert(key == "columns" ? "fields" : key).second) {
      lines_.fail("found a second " + shown(word) + " line, expected one");
    }
    if (key == "fields" || key == "columns") {
      if (values.empty()) lines_.fail("found no names after FIELDS, expected x y z ...");
      if (values.size() > kMostFields) {
        lines_.fail("found " + std::to_string(values.size()) + " fields, expected at most " +
                    std::to_string(kMostFields));
      }
      for (const std::string_view name : values) {
        PcdField field;
        field.name = std::string(name);
        fields_.push_back(std::move(field));
      }
    } else if (key == "size") {
      expect_one_each(values, "SIZE");
      for (std::size_t i = 0; i < values.size(); ++i) {
        std::uint64_t size = 0;
        if (!parse_unsigned(values[i], size) ||
            (size != 1 && size != 2 && size != 4 && size != 8)) {
          lines_.fail("found size " + shown(values[i]) + ", expected 1, 2, 4 or 8");
        }
        fields_[i].size = size;
      }
      sizes_seen = true;
    } else if (key == "type") {
      expect_one_each(values, "TYPE");
      for (std::size_t i = 0; i < values.size(); ++i) {
        const std::string_view type = values[i];
        if (type != "F" && type != "I" && type != "U" && type != "f" && type != "i" &&
            type != "u") {
          lines_.fail("found type " + shown(type) + ", expected I, U or F");
        }
        fields_[i].type = static_cast<char>(type[0] & ~0x20);
      }
      types_seen = true;
    } else if (key == "count") {
      expect_one_each(values, "COUNT");
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (!parse_unsigned(values[i], fields_[i].count) || fields_[i].count > 1u << 24) {
          lines_.fail("found count " + shown(values[i]) + ", expected a number below 16777217");
        }
      }
    } else if (key == "width") {
      width = number(values, "WIDTH");
    } else if (key == "height") {
      height = number(values, "HEIGHT");
    } else if (key == "points") {
      points = number(values, "POINTS");
    } else if (key == "data") {
      if (values.size() != 1) lines_.fail("found " + shown(line) + ", expected DATA and one word");
      const std::string data = lower_case(values[0]);
      if (data == "ascii") {
        body_ = Body::kAscii;
      } else if (data == "binary") {
        body_ = Body::kBinary;
      } else if (data == "binary_compressed") {
        body_ = Body::kCompressed;
      } else {
        lines_.fail("found DATA " + shown(values[0]) +
                    ", expected ascii, binary or binary_compressed");
      }
      report_.encoding = data;
      break;
    }
  }
  if (fields_.empty()) lines_.fail("found DATA, expected a FIELDS line before it");
  if (body_ != Body::kAscii && (!sizes_seen || !types_seen)) {
    lines_.fail("found no SIZE or no TYPE line, expected both before binary data");
  }
  if (!points && !width)
    lines_.fail("found no POINTS and no WIDTH line, expected the number of points");
  if (width) {
    const std::uint64_t rows = height.value_or(1);
    constexpr std::uint64_t kLargest = std::numeric_limits<std::uint32_t>::max();
    if (*width > kLargest || rows > kLargest) {
      lines_.fail("found WIDTH " + std::to_string(*width) + " and HEIGHT " + std::to_string(rows) +
                  ", expected numbers below 4294967296");
    }
    const std::uint64_t product = *width * rows;  // below 2^64
    if (points && *points != product) {
      lines_.fail("found POINTS " + std::to_string(*points) +
                  ", expected WIDTH x HEIGHT = " + std::to_string(product));
    }
    points_ = product;
    if (rows > 1) {
      report_.width = static_cast<std::uint32_t>(*width);
      report_.height = static_cast<std::uint32_t>(rows);
    }
  } else {
    points_ = *points;
  }
  report_.declared = points_;
  lay_out();
}

void PcdSource::lay_out() {
  std::set<std::string> names;
  for (PcdField& field : fields_) {
    const std::optional<ScalarType> type = scalar_type(field.type, field.size);
    if (!type) {
      lines_.fail("found type " + std::string(1, field.type) + " of " + std::to_string(field.size) +
                  " bytes for field " + shown(field.name) + ", expected F of 4 or 8 bytes");
    }
    const std::uint64_t bytes = field.size * field.count;
    field.kept = field.name != "_" && field.count > 0;
    if (field.name == "_") padding_size_ += bytes;
    if (field.kept && field.count > kMostElements) {
      field.kept = false;
      report_.notes.push_back("field '" + field.name + "' with " + std::to_string(field.count) +
                              " values a point is not kept");
    }
    const std::string lower = lower_case(field.name);
    const bool packed = (lower == "rgb" || lower == "rgba") && field.size == 4 && field.count == 1;
    for (std::uint64_t k = 0; k < field.count && field.kept; ++k) {
      PointField column;
      column.name = field.count == 1 ? field.name : field.name + "_" + std::to_string(k);
      column.type = packed ? ScalarType::kUint32 : *type;
      if (!names.insert(column.name).second) {
        if (!options_.lenient) {
          lines_.fail("found field " + shown(column.name) + " twice, expected different names");
        }
        report_.notes.push_back("the second field '" + column.name + "' is not kept");
        column.name += "_" + std::to_string(names.size());
        while (!names.insert(column.name).second) column.name += "_";
      }
      RecordReader::Field place;
      place.offset = static_cast<std::size_t>(record_size_ + k * field.size);
      place.type = column.type;
      places_.push_back(place);
      header_.fields.push_back(std::move(column));
      if (places_.size() > kMostFields) {
        lines_.fail("found more than " + std::to_string(kMostFields) + " values a point");
      }
    }
    if (body_ == Body::kAscii) {
      values_per_row_ += field.count;
      if (values_per_row_ > kMostRowValues) {
        lines_.fail("found more than " + std::to_string(kMostRowValues) + " values a point");
      }
      ColumnRule rule;
      rule.type = *type;
      rule.packed_color = packed && field.type == 'F';
      const std::size_t first = header_.fields.size() - (field.kept ? field.count : 0);
      for (std::uint64_t k = 0; k < field.count; ++k) {
        if (field.kept) rule.column = static_cast<int>(first + k);
        rules_.push_back(rule);
      }
    }
    record_size_ += bytes;  // at most 4096 fields of 2^27 bytes: no overflow
  }
  check_fields("line " + std::to_string(lines_.line()));
}

void PcdSource::start_body() {
  lines_.release();
  const std::uint64_t rest = file_->remaining();
  if (body_ == Body::kBinary) {
    const std::uint64_t count = check_count(points_, record_size_, rest, "points");
    report_.drop("truncated", points_ - count);
    header_.count = count;
    records_ = RecordReader(static_cast<std::size_t>(record_size_), places_, count, false);
    return;
  }
  if (body_ == Body::kAscii) {
    // A value takes at least one digit and one separator, but for the last of the file.
    check_count(points_, 2 * values_per_row_, rest + 1, "points");
    if (!options_.lenient) header_.count = points_;
    std::vector<ScalarType> types;
    for (const PointField& field : header_.fields) types.push_back(field.type);
    const FieldRoles roles = find_roles(header_.fields);
    for (const int axis : roles.position) {
      if (axis >= 0) types[static_cast<std::size_t>(axis)] = ScalarType::kFloat64;
    }
    rows_.start(types);
    read_rows();
    rows_pending_ = true;
    bool large = false;
    for (const int axis : roles.position) large = large || has_large_values(rows_, axis);
    for (const int axis : roles.position) {
      if (axis < 0) continue;
      ScalarType& type = header_.fields[static_cast<std::size_t>(axis)].type;
      if (type == ScalarType::kFloat32 && large) type = ScalarType::kFloat64;
      rows_.set_type(static_cast<std::size_t>(axis), type);
    }
    return;
  }
  // binary_compressed: two sizes, then the columns one after the other.
  if (!file_->fill(8)) {
    if (!options_.lenient) {
      file_->fail_at(file_->size(),
                     "found the end of the file, expected the sizes of the compressed data");
    }
    report_.drop("truncated", points_);
    header_.count = 0;
    return;
  }
  std::uint32_t compressed = 0, uncompressed = 0;
  std::memcpy(&compressed, file_->data(), 4);
  std::memcpy(&uncompressed, file_->data() + 4, 4);
  const std::uint64_t body = file_->position() + 8;
  if (compressed > rest - 8) {
    file_->fail_at(body - 8, "found " + std::to_string(compressed) +
                                 " bytes of compressed data announced, expected at most the " +
                                 std::to_string(rest - 8) + " that follow");
  }
  const std::uint64_t packed_record = record_size_ - padding_size_;
  bool with_padding = false;
  const auto product_is = [&](std::uint64_t size) {
    return size == 0 ? uncompressed == 0
                     : uncompressed % size == 0 && uncompressed / size == points_;
  };
  if (!product_is(packed_record)) {
    with_padding = true;
    if (!product_is(record_size_)) {
      file_->fail_at(body - 4, "found " + std::to_string(uncompressed) +
                                   " bytes of data announced, expected " + std::to_string(points_) +
                                   " points of " + std::to_string(packed_record) + " bytes");
    }
  }
  if (uncompressed > lzf_largest_output(compressed)) {
    file_->fail_at(body - 4, "found " + std::to_string(uncompressed) +
                                 " bytes announced, expected at most " +
                                 std::to_string(lzf_largest_output(compressed)) + " from " +
                                 std::to_string(compressed) + " compressed ones");
  }
  file_->consume(8);
  file_->fill(compressed);
  columns_.resize(uncompressed);
  if (const char* wrong =
          lzf_decompress(file_->data(), compressed, columns_.data(), uncompressed)) {
    file_->fail_at(body,
                   std::string("found damaged compressed data (") + wrong + "), expected LZF");
  }
  file_->consume(compressed);
  header_.count = points_;
  std::size_t start = 0;
  for (const PcdField& field : fields_) {
    if (field.name == "_" && !with_padding) continue;
    const std::size_t stride = static_cast<std::size_t>(field.size * field.count);
    for (std::uint64_t k = 0; k < field.count && field.kept; ++k) {
      column_start_.push_back(start + static_cast<std::size_t>(k * field.size));
      column_stride_.push_back(stride);
    }
    start += stride * static_cast<std::size_t>(points_);
  }
}

void PcdSource::check_padding() {
  if (tail_checked_) return;
  tail_checked_ = true;
  const std::uint64_t start = file_->position();
  const std::uint64_t rest = file_->remaining();
  while (file_->remaining() > 0) {
    file_->fill(1);
    for (std::size_t i = 0; i < file_->available(); ++i) {
      const unsigned char byte = file_->data()[i];
      if (byte == 0 || byte == '\n' || byte == '\r' || byte == ' ') continue;
      if (options_.lenient) {
        report_.notes.push_back(std::to_string(rest) + " bytes behind the last point are ignored");
        return;
      }
      file_->fail_at(start, "found " + std::to_string(rest) +
                                " bytes behind the last point, expected the end of the file or "
                                "zeros");
    }
    file_->consume(file_->available());
  }
}

bool PcdSource::next_binary(PointBatch& batch) {
  if (records_.next(*file_, batch)) return true;
  if (report_.dropped.empty()) check_padding();
  return false;
}

bool PcdSource::next_compressed(PointBatch& batch) {
  const std::uint64_t count =
      std::min<std::uint64_t>(kBatchSize, header_.count.value_or(0) - rows_done_);
  batch.count = static_cast<std::size_t>(count);
  batch.fields.clear();
  if (count == 0) {
    if (report_.dropped.empty()) check_padding();
    return false;
  }
  for (std::size_t c = 0; c < column_start_.size(); ++c) {
    batch.fields.push_back({columns_.data() + column_start_[c] +
                                static_cast<std::size_t>(rows_done_) * column_stride_[c],
                            column_stride_[c]});
  }
  rows_done_ += count;
  return true;
}

void PcdSource::read_rows() {
  rows_.clear();
  std::string_view line;
  while (!rows_.full() && rows_done_ < points_) {
    if (!lines_.next(line)) {
      if (!options_.lenient) {
        file_->fail_at(file_->size(), "found the end of the file after " +
                                          std::to_string(rows_done_) + " points, expected " +
                                          std::to_string(points_));
      }
      report_.drop("truncated", points_ - rows_done_);
      rows_done_ = points_;
      break;
    }
    std::string_view rest = line;
    if (next_word(rest).empty()) continue;
    const bool commas = line.find(',') != std::string_view::npos;
    if (commas && !commas_noted_) {
      commas_noted_ = true;
      report_.notes.emplace_back("the values are separated by commas, where PCD has blanks");
    }
    const std::string wrong = parse_row(line, rules_, commas ? ',' : ' ', rows_.new_row());
    ++rows_done_;
    if (wrong.empty()) {
      rows_.keep_row();
    } else if (options_.lenient) {
      report_.drop("bad line");
    } else {
      lines_.fail(wrong);
    }
  }
}

bool PcdSource::next_ascii(PointBatch& batch) {
  if (!rows_pending_) read_rows();
  rows_pending_ = false;
  rows_.fill(batch);
  if (batch.count > 0) return true;
  lines_.release();
  check_padding();
  return false;
}

// --- writing -----------------------------------------------------------------------------------

class PcdSink : public PointSink {
 public:
  PcdSink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), encoding_(encoding) {
    if (encoding == CloudEncoding::kBigEndian) {
      throw std::invalid_argument(
          "PCD has no big-endian encoding, expected binary, ascii or compressed");
    }
    if (!header.count) start_ = out.tellp();
    roles_ = find_roles(header.fields);
    const bool bytes = roles_.color[0] >= 0 && byte_sized(roles_.color[0]) &&
                       byte_sized(roles_.color[1]) && byte_sized(roles_.color[2]);
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      const int index = static_cast<int>(f);
      if (bytes && (index == roles_.color[1] || index == roles_.color[2])) continue;
      Column column;
      column.source = index;
      column.name = header.fields[f].name;
      column.type = header.fields[f].type;
      if (bytes && index == roles_.color[0]) {
        column.name = "rgb";
        column.type = ScalarType::kUint32;
        column.packed = true;
      }
      if (index == roles_.packed_color) column.packed_already = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        static const char* const kAxes[] = {"x", "y", "z"};
        static const char* const kNormals[] = {"normal_x", "normal_y", "normal_z"};
        if (index == roles_.position[axis]) column.name = kAxes[axis];
        if (index == roles_.normal[axis]) column.name = kNormals[axis];
      }
      for (char& c : column.name) {
        if (is_blank(c) || c == '\n') c = '_';
      }
      columns_.push_back(column);
    }
    if (encoding == CloudEncoding::kCompressed) {
      collected_.resize(columns_.size());
    } else {
      write_header(header.count);
    }
  }

  void write(const PointBatch& batch) override {
    count_ += batch.count;
    PointBatch packed = repack(batch);
    if (encoding_ == CloudEncoding::kCompressed) {
      for (std::size_t c = 0; c < columns_.size(); ++c) {
        PointBatch one;
        one.count = batch.count;
        one.fields = {packed.fields[c]};
        PointField field;
        field.type = columns_[c].type;
        pack_records(one, {field}, false, collected_[c]);
      }
      return;
    }
    text_.clear();
    if (encoding_ == CloudEncoding::kAscii) {
      for (std::size_t i = 0; i < batch.count; ++i) {
        for (std::size_t c = 0; c < columns_.size(); ++c) {
          if (c > 0) text_ += ' ';
          append_value(text_, packed.fields[c], columns_[c].type, i);
        }
        text_ += '\n';
      }
    } else {
      pack_records(packed, fields_, false, text_);
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {
    if (encoding_ == CloudEncoding::kCompressed) {
      write_header(count_);
      std::string all;
      for (std::string& column : collected_) {
        all += column;
        column = {};
      }
      const std::string compressed =
          lzf_compress(reinterpret_cast<const unsigned char*>(all.data()), all.size());
      if (all.size() > UINT32_MAX || compressed.size() > UINT32_MAX) {
        throw std::invalid_argument("the cloud has " + std::to_string(all.size()) +
                                    " bytes, expected fewer than 4 GiB for a compressed PCD");
      }
      const std::uint32_t sizes[2] = {static_cast<std::uint32_t>(compressed.size()),
                                      static_cast<std::uint32_t>(all.size())};
      out_.write(reinterpret_cast<const char*>(sizes), 8);
      out_.write(compressed.data(), static_cast<std::streamsize>(compressed.size()));
      return;
    }
    if (!header_.count) {
      const std::ostream::pos_type end = out_.tellp();
      out_.seekp(start_);
      write_header(count_);
      out_.seekp(end);
    }
  }

 private:
  struct Column {
    int source = -1;
    std::string name;
    ScalarType type = ScalarType::kFloat32;
    bool packed = false;          // made from red, green, blue
    bool packed_already = false;  // 0xRRGGBB in the source
  };

  bool byte_sized(int field) const {
    return size_of(header_.fields[static_cast<std::size_t>(field)].type) == 1;
  }

  PointBatch repack(const PointBatch& batch) {
    PointBatch out;
    out.count = batch.count;
    for (const Column& column : columns_) {
      if (!column.packed) {
        out.fields.push_back(batch.fields[static_cast<std::size_t>(column.source)]);
        continue;
      }
      packed_.resize(batch.count);
      for (std::size_t i = 0; i < batch.count; ++i) {
        std::uint32_t rgb = 0;
        for (const int channel : roles_.color) {
          rgb = rgb << 8 | batch.fields[static_cast<std::size_t>(channel)].get<std::uint8_t>(i);
        }
        packed_[i] = rgb;
      }
      out.fields.push_back({reinterpret_cast<const unsigned char*>(packed_.data()), 4});
    }
    return out;
  }

  /// @param count unknown: room is left for the largest number.
  void write_header(std::optional<std::uint64_t> count) {
    constexpr std::size_t kDigits = 20;
    std::string names, sizes, types, counts;
    fields_.clear();
    for (const Column& column : columns_) {
      names += ' ' + column.name;
      sizes += ' ' + std::to_string(size_of(column.type));
      // In binary data PCL wants the packed colour as a float, in ASCII as a whole number.
      const bool color_as_float = (column.packed || column.packed_already) &&
                                  encoding_ != CloudEncoding::kAscii && column.name != "rgba";
      types += is_float(column.type) || color_as_float ? " F"
               : column.type == ScalarType::kUint8 || column.type == ScalarType::kUint16 ||
                       column.type == ScalarType::kUint32 || column.type == ScalarType::kUint64
                   ? " U"
                   : " I";
      counts += " 1";
      PointField field;
      field.type = column.type;
      fields_.push_back(field);
    }
    const std::string number = count ? std::to_string(*count) : std::string(kDigits, '0');
    std::string head = "# .PCD v0.7 - Point Cloud Data file format\n";
    for (const std::string& comment : camber_comments(header_)) head += "# " + comment + "\n";
    if (!header_.count && encoding_ != CloudEncoding::kCompressed) {
      head += "# " + std::string(2 * (kDigits - number.size()), '-') + "\n";
    }
    head += "VERSION 0.7\nFIELDS" + names + "\nSIZE" + sizes + "\nTYPE" + types + "\nCOUNT" +
            counts + "\nWIDTH " + number + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + number +
            "\nDATA " +
            (encoding_ == CloudEncoding::kAscii    ? "ascii"
             : encoding_ == CloudEncoding::kBinary ? "binary"
                                                   : "binary_compressed") +
            "\n";
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  CloudEncoding encoding_;
  FieldRoles roles_;
  std::vector<Column> columns_;
  std::vector<PointField> fields_;
  std::vector<std::string> collected_;
  std::vector<std::uint32_t> packed_;
  std::string text_;
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
};

}  // namespace

std::unique_ptr<PointSource> open_pcd(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<PcdSource>(std::move(file), options);
}

std::unique_ptr<PointSink> make_pcd_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding) {
  return std::make_unique<PcdSink>(out, header, encoding);
}

}  // namespace camber
