// PLY files: Greg Turk's polygon format (1994) with the type names that later writers added.

#include <algorithm>
#include <cmath>

#include "camber/cloud/detail/ply_header.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

using detail::face_indices;
using detail::PlyElement;
using detail::PlyProperty;

constexpr bool kLittleEndianMachine = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
static_assert(kLittleEndianMachine, "the readers of binary files need a little-endian machine");

class PlySource : public FormatSource {
 public:
  PlySource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kPly;
    take_crs({});
    ply_ = detail::read_ply_header(
        *file_, lines_, options_.lenient, [this](std::string_view text) { read_comment(text); },
        &report_);
    start_points();
  }

  bool next(PointBatch& batch) override {
    batch.count = 0;
    if (!done_) {
      if (ply_.ascii) {
        next_ascii(batch);
      } else if (vertex().has_lists) {
        next_with_lists(batch);
      } else {
        records_.next(*file_, batch);
      }
      report_.points += batch.count;
      if (batch.count > 0) return true;
      done_ = true;
      if (!truncated_) {
        for (std::size_t e = ply_.vertex + 1; e < ply_.elements.size() && !truncated_; ++e) {
          pass_element(ply_.elements[e]);
        }
      }
      if (!truncated_) check_tail();
      check_triangles();
    }
    return false;
  }

 private:
  const PlyElement& vertex() const { return ply_.elements[ply_.vertex]; }
  void start_points();
  void next_ascii(PointBatch& batch);
  void read_rows();
  void next_with_lists(PointBatch& batch);
  void pass_element(const PlyElement& element);
  void pass_ascii(const PlyElement& element, bool faces);
  void pass_binary(const PlyElement& element, bool faces);
  bool read_list_row(const PlyElement& element, std::vector<double>* values,
                     std::vector<double>* indices, int index_property);
  std::string parse_list_line(std::string_view line, const PlyElement& element,
                              std::vector<double>* values, std::vector<double>* indices,
                              int index_property);
  void add_face(const std::vector<double>& indices);
  void check_tail();
  void check_triangles();
  void end_early(const PlyElement& element, std::uint64_t done);
  double binary_value(const unsigned char* data, ScalarType type) const;

  detail::PlyHeader ply_;
  bool done_ = false;
  bool truncated_ = false;
  std::vector<int> columns_;  // of the vertex properties, -1: a list
  std::uint64_t rows_done_ = 0;
  RecordReader records_;
  RowBuffer rows_;
  std::vector<ColumnRule> rules_;
  bool rows_pending_ = false;
  std::vector<double> row_values_, indices_;
};

void PlySource::start_points() {
  const PlyElement& element = vertex();
  std::vector<ScalarType> types;
  std::vector<RecordReader::Field> places;
  std::size_t offset = 0;
  for (const PlyProperty& property : element.properties) {
    columns_.push_back(property.list ? -1 : static_cast<int>(header_.fields.size()));
    if (property.list) {
      report_.notes.push_back("the list property '" + property.name + "' is not kept");
      continue;
    }
    PointField field;
    field.name = property.name;
    field.type = property.type;
    header_.fields.push_back(field);
    types.push_back(property.type);
    RecordReader::Field place;
    place.offset = offset;
    place.type = property.type;
    places.push_back(place);
    offset += size_of(property.type);
    ColumnRule rule;
    rule.type = property.type;
    rule.column = columns_.back();
    rules_.push_back(rule);
  }
  check_fields("line " + std::to_string(lines_.line()));
  for (std::size_t e = 0; e < ply_.vertex && !truncated_; ++e) pass_element(ply_.elements[e]);
  const FieldRoles roles = find_roles(header_.fields);
  if (ply_.ascii) {
    // Some writers print colours of type char as 128 to 255.
    for (const int channel : roles.color) {
      if (channel < 0) continue;
      for (ColumnRule& rule : rules_) {
        if (rule.column == channel && rule.type == ScalarType::kInt8)
          rule.type = ScalarType::kInt16;
      }
      PointField& field = header_.fields[static_cast<std::size_t>(channel)];
      if (field.type == ScalarType::kInt8)
        field.type = types[static_cast<std::size_t>(channel)] = ScalarType::kInt16;
    }
    rows_.start(types);
    if (!options_.lenient) header_.count = element.count;
    read_rows();
    rows_pending_ = true;
    bool large = false;
    for (const int axis : roles.position) large = large || has_large_values(rows_, axis);
    for (const int axis : roles.position) {
      if (axis < 0 || !large) continue;
      ScalarType& type = header_.fields[static_cast<std::size_t>(axis)].type;
      if (type != ScalarType::kFloat32) continue;
      type = ScalarType::kFloat64;
      rows_.set_type(static_cast<std::size_t>(axis), type);
    }
  } else if (element.has_lists) {
    rows_.start(types);
    if (!options_.lenient) header_.count = element.count;
  } else {
    const std::uint64_t count =
        truncated_ ? 0
                   : check_count(element.count, element.fixed_size, file_->remaining(), "vertices");
    if (count < element.count) {
      report_.drop("truncated", element.count - count);
      truncated_ = true;
    }
    header_.count = count;
    records_ = RecordReader(static_cast<std::size_t>(element.fixed_size), std::move(places), count,
                            ply_.big_endian);
  }
}

void PlySource::end_early(const PlyElement& element, std::uint64_t done) {
  if (!options_.lenient) {
    file_->fail_at(file_->size(), "found the end of the file after " + std::to_string(done) +
                                      " of element " + shown(element.name) + ", expected " +
                                      std::to_string(element.count));
  }
  truncated_ = true;
  if (element.name == "vertex") {
    report_.drop("truncated", element.count - done);
  } else {
    report_.notes.push_back("the file ends after " + std::to_string(done) + " of " +
                            std::to_string(element.count) + " of element '" + element.name + "'");
  }
}

double PlySource::binary_value(const unsigned char* data, ScalarType type) const {
  return with_type(type, [&](auto tag) {
    unsigned char bytes[sizeof(tag)];
    std::memcpy(bytes, data, sizeof bytes);
    if (ply_.big_endian) std::reverse(bytes, bytes + sizeof bytes);
    std::memcpy(&tag, bytes, sizeof bytes);
    return static_cast<double>(tag);
  });
}

/// Reads one binary record with lists; false if the file ends before its end.
/// @param values   of the properties that are not lists, if wanted
/// @param indices  of one list, if wanted
bool PlySource::read_list_row(const PlyElement& element, std::vector<double>* values,
                              std::vector<double>* indices, int index_property) {
  std::size_t column = 0;
  for (std::size_t p = 0; p < element.properties.size(); ++p) {
    const PlyProperty& property = element.properties[p];
    if (!property.list) {
      const std::size_t size = size_of(property.type);
      if (!file_->fill(size)) return false;
      if (values != nullptr) (*values)[column++] = binary_value(file_->data(), property.type);
      file_->consume(size);
      continue;
    }
    const std::size_t count_size = size_of(property.count_type);
    if (!file_->fill(count_size)) return false;
    const double announced = binary_value(file_->data(), property.count_type);
    const std::uint64_t size = size_of(property.type);
    const std::uint64_t rest = file_->remaining() - count_size;
    if (announced < 0.0) {
      file_->fail_at(file_->position(), "found a list of " + std::to_string(announced) +
                                            " values, expected 0 or more");
    }
    if (announced > static_cast<double>(rest / size)) return false;
    const std::uint64_t count = static_cast<std::uint64_t>(announced);
    file_->consume(count_size);
    if (indices != nullptr && static_cast<int>(p) == index_property) {
      for (std::uint64_t k = 0; k < count; ++k) {
        file_->fill(static_cast<std::size_t>(size));
        indices->push_back(binary_value(file_->data(), property.type));
        file_->consume(static_cast<std::size_t>(size));
      }
    } else {
      file_->skip(count * size);
    }
  }
  return true;
}

void PlySource::next_with_lists(PointBatch& batch) {
  const PlyElement& element = vertex();
  rows_.clear();
  row_values_.resize(header_.fields.size());
  while (!truncated_ && !rows_.full() && rows_done_ < element.count) {
    if (!read_list_row(element, &row_values_, nullptr, -1)) {
      end_early(element, rows_done_);
      break;
    }
    std::copy(row_values_.begin(), row_values_.end(), rows_.new_row());
    rows_.keep_row();
    ++rows_done_;
  }
  rows_.fill(batch);
}

/// Checks one text line with lists; returns what is wrong with it, or nothing.
std::string PlySource::parse_list_line(std::string_view line, const PlyElement& element,
                                       std::vector<double>* values, std::vector<double>* indices,
                                       int index_property) {
  const char* p = line.data();
  const char* const end = p + line.size();
  std::string wrong;
  const auto number = [&](ScalarType type, double& value) {
    while (p < end && is_blank(*p)) ++p;
    if (p == end) {
      wrong = "found the end of the line, expected more values";
      return false;
    }
    const ParsedNumber parsed = parse_number(p, end);
    if (parsed.end == nullptr || (parsed.end < end && !is_blank(*parsed.end)) ||
        (!is_float(type) &&
         !(std::floor(parsed.value) == parsed.value && std::abs(parsed.value) < 1e18))) {
      std::string_view rest(p, static_cast<std::size_t>(end - p));
      wrong = "found " + shown(next_word(rest)) + ", expected " +
              (is_float(type) ? "a number" : "a whole number");
      return false;
    }
    value = parsed.value;
    p = parsed.end;
    return true;
  };
  std::size_t column = 0;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    double value = 0.0;
    if (!property.list) {
      if (!number(property.type, value)) return wrong;
      if (values != nullptr) (*values)[column++] = value;
      continue;
    }
    if (!number(property.count_type, value)) return wrong;
    if (value < 0.0 || value > static_cast<double>(line.size())) {
      return "found a list of " + std::to_string(static_cast<long long>(value)) +
             " values, expected what the line has room for";
    }
    const std::uint64_t count = static_cast<std::uint64_t>(value);
    for (std::uint64_t k = 0; k < count; ++k) {
      if (!number(property.type, value)) return wrong;
      if (indices != nullptr && static_cast<int>(i) == index_property) indices->push_back(value);
    }
  }
  while (p < end && is_blank(*p)) ++p;
  if (p != end) return "found more values than the header states";
  return {};
}

void PlySource::read_rows() {
  const PlyElement& element = vertex();
  rows_.clear();
  std::string_view line;
  while (!truncated_ && !rows_.full() && rows_done_ < element.count) {
    if (!lines_.next(line)) {
      end_early(element, rows_done_);
      break;
    }
    std::string_view rest = line;
    if (next_word(rest).empty()) continue;
    std::string wrong;
    if (element.has_lists) {
      row_values_.resize(header_.fields.size());
      wrong = parse_list_line(line, element, &row_values_, nullptr, -1);
      if (wrong.empty()) {
        // The rules are those of the properties that are not lists: check their ranges.
        std::string plain;
        for (const double value : row_values_) {
          append_number(plain, value);
          plain += ' ';
        }
        wrong = parse_row(plain, rules_, ' ', rows_.new_row());
      }
    } else {
      wrong = parse_row(line, rules_, ' ', rows_.new_row());
    }
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

void PlySource::next_ascii(PointBatch& batch) {
  if (!rows_pending_) read_rows();
  rows_pending_ = false;
  rows_.fill(batch);
}

void PlySource::add_face(const std::vector<double>& indices) {
  for (const double index : indices) {
    if (!(index >= 0.0 && index < static_cast<double>(vertex().count) && index <= 4294967295.0 &&
          std::floor(index) == index)) {
      if (!options_.lenient) {
        throw InputError(file_->name(),
                         ply_.ascii ? "line " + std::to_string(lines_.line())
                                    : "byte " + std::to_string(file_->position()),
                         "found a face with vertex " + std::to_string(index) +
                             ", expected one below " + std::to_string(vertex().count));
      }
      report_.drop("faces with bad indices");
      return;
    }
  }
  for (std::size_t k = 2; k < indices.size(); ++k) {
    triangles_.push_back({static_cast<std::uint32_t>(indices[0]),
                          static_cast<std::uint32_t>(indices[k - 1]),
                          static_cast<std::uint32_t>(indices[k])});
  }
}

void PlySource::pass_element(const PlyElement& element) {
  if (element.properties.empty()) return;
  const bool faces = options_.triangles && face_indices(element) >= 0;
  if (ply_.ascii) {
    pass_ascii(element, faces);
  } else {
    pass_binary(element, faces);
  }
}

void PlySource::pass_ascii(const PlyElement& element, bool faces) {
  const int index_property = face_indices(element);
  std::string_view line;
  for (std::uint64_t done = 0; done < element.count;) {
    if (!lines_.next(line)) {
      end_early(element, done);
      return;
    }
    std::string_view rest = line;
    if (next_word(rest).empty()) continue;
    indices_.clear();
    const std::string wrong =
        parse_list_line(line, element, nullptr, faces ? &indices_ : nullptr, index_property);
    ++done;
    if (wrong.empty()) {
      if (faces) add_face(indices_);
    } else if (!options_.lenient) {
      lines_.fail(wrong);
    }
  }
}

void PlySource::pass_binary(const PlyElement& element, bool faces) {
  if (!element.has_lists) {
    const std::uint64_t fitting = file_->remaining() / element.fixed_size;
    if (element.count > fitting) {
      end_early(element, fitting);
      return;
    }
    file_->skip(element.count * element.fixed_size);
    return;
  }
  const int index_property = face_indices(element);
  for (std::uint64_t done = 0; done < element.count; ++done) {
    indices_.clear();
    if (!read_list_row(element, nullptr, faces ? &indices_ : nullptr, index_property)) {
      end_early(element, done);
      return;
    }
    if (faces) add_face(indices_);
  }
}

void PlySource::check_tail() {
  lines_.release();
  const std::uint64_t start = file_->position(), rest = file_->remaining();
  while (file_->remaining() > 0) {
    file_->fill(1);
    for (std::size_t i = 0; i < file_->available(); ++i) {
      const unsigned char byte = file_->data()[i];
      if (byte == 0 || byte == '\n' || byte == '\r' || byte == ' ' || byte == '\t') continue;
      if (options_.lenient) {
        report_.notes.push_back(std::to_string(rest) +
                                " bytes behind the last element are ignored");
        return;
      }
      file_->fail_at(start, "found " + std::to_string(rest) +
                                " bytes behind the last element, expected the end of the file");
    }
    file_->consume(file_->available());
  }
}

/// Lenient reading may have lost vertices that faces name.
void PlySource::check_triangles() {
  const std::uint64_t points = report_.points;
  if (points == vertex().count) return;
  for (const auto& [reason, count] : report_.dropped) {
    if (reason != "bad line" || triangles_.empty()) continue;
    triangles_.clear();
    report_.notes.emplace_back("the faces are not kept, since vertices before others are missing");
    return;
  }
  const auto bad = [&](const std::array<std::uint32_t, 3>& t) {
    return t[0] >= points || t[1] >= points || t[2] >= points;
  };
  triangles_.erase(std::remove_if(triangles_.begin(), triangles_.end(), bad), triangles_.end());
}

}  // namespace

std::unique_ptr<PointSource> open_ply(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<PlySource>(std::move(file), options);
}

}  // namespace camber
