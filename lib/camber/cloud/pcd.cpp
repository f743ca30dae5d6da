// PCD files: http://pointclouds.org/documentation/tutorials/pcd_file_format.html, and what PCL's
// own writer does beyond it (padding behind the points, the packed rgb field).

#include <algorithm>
#include <set>

#include "camber/cloud/detail/pcd_header.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/lzf.h"
#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

using detail::PcdBody;

constexpr std::size_t kMostRowValues = 1 << 16;
constexpr std::uint64_t kMostElements = 64;  // a field of more is a descriptor and is not kept

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
    take_crs({});
    pcd_ = detail::read_pcd_header(
        *file_, lines_, [this](std::string_view text) { read_comment(text); }, &report_);
    header_.width = report_.width;
    header_.height = report_.height;
    header_.viewpoint = pcd_.viewpoint;
    lay_out();
    start_body();
  }

  bool next(PointBatch& batch) override {
    bool more = false;
    switch (pcd_.body) {
      case PcdBody::kAscii:
        more = next_ascii(batch);
        break;
      case PcdBody::kBinary:
        more = next_binary(batch);
        break;
      case PcdBody::kCompressed:
        more = next_compressed(batch);
        break;
    }
    report_.points += batch.count;
    return more;
  }

 private:
  void lay_out();
  void start_body();
  void start_ascii(std::uint64_t rest);
  void start_compressed(std::uint64_t rest);
  bool next_ascii(PointBatch& batch);
  bool next_binary(PointBatch& batch);
  bool next_compressed(PointBatch& batch);
  void check_padding();
  void read_rows();

  detail::PcdHeader pcd_;
  std::uint64_t record_size_ = 0;   // with padding fields
  std::uint64_t padding_size_ = 0;  // of the fields named "_"
  std::uint64_t values_per_row_ = 0;
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

void PcdSource::lay_out() {
  std::set<std::string> names;
  for (detail::PcdField& field : pcd_.fields) {
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
      if (places_.size() > detail::kMostPcdFields) {
        lines_.fail("found more than " + std::to_string(detail::kMostPcdFields) +
                    " values a point");
      }
    }
    if (pcd_.body == PcdBody::kAscii) {
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
  if (pcd_.body == PcdBody::kBinary) {
    const std::uint64_t count = check_count(pcd_.points, record_size_, rest, "points");
    report_.drop("truncated", pcd_.points - count);
    header_.count = count;
    records_ = RecordReader(static_cast<std::size_t>(record_size_), places_, count, false);
    return;
  }
  if (pcd_.body == PcdBody::kAscii) {
    start_ascii(rest);
    return;
  }
  start_compressed(rest);
}

/// Reads the first rows, which decide about the precision of the coordinates.
/// @param rest  bytes behind the header
void PcdSource::start_ascii(std::uint64_t rest) {
  // A value takes at least one digit and one separator, but for the last of the file.
  check_count(pcd_.points, 2 * values_per_row_, rest + 1, "points");
  if (!options_.lenient) header_.count = pcd_.points;
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
}

/// Decompresses the columns: two sizes, then the columns one after the other.
/// @param rest  bytes behind the header
void PcdSource::start_compressed(std::uint64_t rest) {
  if (!file_->fill(8)) {
    if (!options_.lenient) {
      file_->fail_at(file_->size(),
                     "found the end of the file, expected the sizes of the compressed data");
    }
    report_.drop("truncated", pcd_.points);
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
                     : uncompressed % size == 0 && uncompressed / size == pcd_.points;
  };
  if (!product_is(packed_record)) {
    with_padding = true;
    if (!product_is(record_size_)) {
      file_->fail_at(body - 4, "found " + std::to_string(uncompressed) +
                                   " bytes of data announced, expected " +
                                   std::to_string(pcd_.points) + " points of " +
                                   std::to_string(packed_record) + " bytes");
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
  header_.count = pcd_.points;
  std::size_t start = 0;
  for (const detail::PcdField& field : pcd_.fields) {
    if (field.name == "_" && !with_padding) continue;
    const std::size_t stride = static_cast<std::size_t>(field.size * field.count);
    for (std::uint64_t k = 0; k < field.count && field.kept; ++k) {
      column_start_.push_back(start + static_cast<std::size_t>(k * field.size));
      column_stride_.push_back(stride);
    }
    start += stride * static_cast<std::size_t>(pcd_.points);
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
  while (!rows_.full() && rows_done_ < pcd_.points) {
    if (!lines_.next(line)) {
      if (!options_.lenient) {
        file_->fail_at(file_->size(), "found the end of the file after " +
                                          std::to_string(rows_done_) + " points, expected " +
                                          std::to_string(pcd_.points));
      }
      report_.drop("truncated", pcd_.points - rows_done_);
      rows_done_ = pcd_.points;
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

}  // namespace

std::unique_ptr<PointSource> open_pcd(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<PcdSource>(std::move(file), options);
}

}  // namespace camber
