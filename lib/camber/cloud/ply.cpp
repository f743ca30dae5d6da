// PLY files: Greg Turk's polygon format (1994) with the type names that later writers added.

#include <algorithm>
#include <cmath>
#include <set>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kHeaderLine = 1 << 16;  // bytes
constexpr std::size_t kMostProperties = 4096;
constexpr std::size_t kMostElements = 4096;

struct Property {
  std::string name;
  ScalarType type = ScalarType::kFloat32;  // of the values
  bool list = false;
  ScalarType count_type = ScalarType::kUint8;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
  bool has_lists = false;
  std::uint64_t fixed_size = 0;  // bytes of a binary record without its lists' values
  std::uint64_t least_size = 0;  // bytes of the shortest possible record
};

std::optional<ScalarType> scalar_type(std::string_view name) {
  static const std::pair<const char*, ScalarType> kNames[] = {
      {"char", ScalarType::kInt8},      {"int8", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},    {"uint8", ScalarType::kUint8},
      {"short", ScalarType::kInt16},    {"int16", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},  {"uint16", ScalarType::kUint16},
      {"int", ScalarType::kInt32},      {"int32", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},    {"uint32", ScalarType::kUint32},
      {"int64", ScalarType::kInt64},    {"long", ScalarType::kInt64},
      {"uint64", ScalarType::kUint64},  {"ulong", ScalarType::kUint64},
      {"float", ScalarType::kFloat32},  {"float32", ScalarType::kFloat32},
      {"double", ScalarType::kFloat64}, {"float64", ScalarType::kFloat64},
  };
  for (const auto& [known, type] : kNames) {
    if (name == known) return type;
  }
  return std::nullopt;
}

const char* name_of(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
      return "char";
    case ScalarType::kUint8:
      return "uchar";
    case ScalarType::kInt16:
      return "short";
    case ScalarType::kUint16:
      return "ushort";
    case ScalarType::kInt32:
      return "int";
    case ScalarType::kUint32:
      return "uint";
    case ScalarType::kInt64:
      return "int64";
    case ScalarType::kUint64:
      return "uint64";
    case ScalarType::kFloat32:
      return "float";
    case ScalarType::kFloat64:
      break;
  }
  return "double";
}

constexpr bool kLittleEndianMachine = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
static_assert(kLittleEndianMachine, "the readers of binary files need a little-endian machine");

class PlySource : public FormatSource {
 public:
  PlySource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kPly;
    read_header();
    check_sizes();
    start_points();
  }

  bool next(PointBatch& batch) override {
    batch.count = 0;
    if (!done_) {
      if (ascii_) {
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
        for (std::size_t e = vertex_ + 1; e < elements_.size() && !truncated_; ++e) {
          pass_element(elements_[e]);
        }
      }
      if (!truncated_) check_tail();
      check_triangles();
    }
    return false;
  }

 private:
  const Element& vertex() const { return elements_[vertex_]; }
  void read_header();
  void read_property(std::string_view rest);
  void check_sizes();
  void start_points();
  void next_ascii(PointBatch& batch);
  void read_rows();
  void next_with_lists(PointBatch& batch);
  void pass_element(const Element& element);
  void pass_ascii(const Element& element, bool faces);
  void pass_binary(const Element& element, bool faces);
  bool read_list_row(const Element& element, std::vector<double>* values,
                     std::vector<double>* indices, int index_property);
  std::string parse_list_line(std::string_view line, const Element& element,
                              std::vector<double>* values, std::vector<double>* indices,
                              int index_property);
  void add_face(const std::vector<double>& indices);
  void check_tail();
  void check_triangles();
  void end_early(const Element& element, std::uint64_t done);
  double binary_value(const unsigned char* data, ScalarType type) const;
  static int face_indices(const Element& element);

  std::vector<Element> elements_;
  std::size_t vertex_ = 0;
  bool ascii_ = false, swap_ = false;
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

void PlySource::read_header() {
  std::string_view line;
  // The first line shows how lines end: \n, \r\n or, on old Macs, \r.
  file_->fill(16);
  const std::string_view start(file_->text(), std::min<std::size_t>(file_->available(), 16));
  const std::size_t end = start.find_first_of("\r\n");
  if (end != std::string_view::npos && start[end] == '\r' &&
      (end + 1 == start.size() || start[end + 1] != '\n')) {
    lines_.set_carriage_return_ends();
  }
  if (!lines_.next(line, kHeaderLine)) file_->fail_at(0, "found an empty file, expected 'ply'");
  std::string_view rest = line;
  if (next_word(rest) != "ply" || !next_word(rest).empty()) {
    lines_.fail("found " + shown(line) + ", expected 'ply'");
  }
  bool format_seen = false;
  std::set<std::string> names;
  while (true) {
    if (!lines_.next(line, kHeaderLine)) {
      file_->fail_at(file_->size(), "found the end of the file, expected end_header");
    }
    if (file_->position() > (std::uint64_t{1} << 24)) {
      lines_.fail("found a header of more than 16 MB, expected end_header before");
    }
    rest = line;
    const std::string_view key = next_word(rest);
    if (key == "comment" || key == "obj_info") {
      if (key == "comment") read_comment(rest);
    } else if (key == "format") {
      const std::string_view format = next_word(rest), version = next_word(rest);
      if (format_seen) lines_.fail("found a second format line, expected one");
      format_seen = true;
      if (format == "ascii") {
        ascii_ = true;
        report_.encoding = "ascii";
      } else if (format == "binary_little_endian") {
        report_.encoding = "binary little endian";
      } else if (format == "binary_big_endian") {
        swap_ = true;
        report_.encoding = "binary big endian";
      } else {
        lines_.fail("found format " + shown(format) +
                    ", expected ascii, binary_little_endian or binary_big_endian");
      }
      if (version != "1.0") lines_.fail("found version " + shown(version) + ", expected 1.0");
    } else if (key == "element") {
      Element element;
      element.name = std::string(next_word(rest));
      const std::string_view count = next_word(rest);
      if (element.name.empty() || !parse_unsigned(count, element.count) ||
          !next_word(rest).empty()) {
        lines_.fail("found " + shown(line) + ", expected 'element NAME COUNT'");
      }
      for (const Element& other : elements_) {
        if (other.name == element.name) {
          lines_.fail("found a second element " + shown(element.name) + ", expected one");
        }
      }
      if (elements_.size() == kMostElements) {
        lines_.fail("found more than " + std::to_string(kMostElements) + " elements");
      }
      names.clear();
      elements_.push_back(std::move(element));
    } else if (key == "property") {
      if (elements_.empty()) lines_.fail("found a property, expected an element before it");
      read_property(rest);
      Property& property = elements_.back().properties.back();
      if (!names.insert(property.name).second) {
        if (!options_.lenient) {
          lines_.fail("found property " + shown(property.name) +
                      " twice, expected different names");
        }
        report_.notes.push_back("the second property '" + property.name + "' has a number added");
        do {
          property.name += "_" + std::to_string(names.size());
        } while (!names.insert(property.name).second);
      }
    } else if (key == "end_header") {
      break;
    } else if (!key.empty()) {
      lines_.fail("found " + shown(key) +
                  ", expected format, comment, obj_info, element, property or end_header");
    }
  }
  if (!format_seen) lines_.fail("found end_header, expected a format line before it");
  const auto found = std::find_if(elements_.begin(), elements_.end(),
                                  [](const Element& e) { return e.name == "vertex"; });
  if (found == elements_.end()) {
    lines_.fail("found no element 'vertex', expected one with x, y and z");
  }
  vertex_ = static_cast<std::size_t>(found - elements_.begin());
  for (const Element& element : elements_) {
    if (element.name == "face") report_.faces = element.count;
  }
}

void PlySource::read_property(std::string_view rest) {
  Property property;
  const std::string line(rest);
  std::string_view word = next_word(rest);
  const auto type = [&](std::string_view name) {
    const std::optional<ScalarType> found = scalar_type(name);
    if (!found) {
      lines_.fail("found property type " + shown(name) +
                  ", expected char, uchar, short, ushort, int, uint, float, double, int8, ...");
    }
    return *found;
  };
  if (word == "list") {
    property.list = true;
    property.count_type = type(next_word(rest));
    if (is_float(property.count_type)) {
      lines_.fail("found a list counted in floats, expected an integer type");
    }
    word = next_word(rest);
  }
  property.type = type(word);
  property.name = std::string(next_word(rest));
  if (property.name.empty() || !next_word(rest).empty()) {
    lines_.fail("found " + shown("property" + line) + ", expected 'property TYPE NAME'");
  }
  Element& element = elements_.back();
  if (element.properties.size() == kMostProperties) {
    lines_.fail("found more than " + std::to_string(kMostProperties) + " properties");
  }
  const std::uint64_t size = size_of(property.list ? property.count_type : property.type);
  element.fixed_size += size;
  element.has_lists = element.has_lists || property.list;
  element.properties.push_back(std::move(property));
}

void PlySource::check_sizes() {
  const std::uint64_t rest = file_->remaining();
  std::uint64_t sum = 0;
  lines_.release();
  for (Element& element : elements_) {
    // A text value takes a digit and a separator, but for the last of the file.
    element.least_size = ascii_ ? 2 * element.properties.size() : element.fixed_size;
    if (element.properties.empty()) continue;  // such an element takes no room, whatever its count
    const std::uint64_t fitting = (rest + 1) / element.least_size;
    if (element.count > fitting || sum + element.count * element.least_size > rest + 1) {
      if (options_.lenient) continue;
      file_->fail_at(file_->size(), "found the end of the file, expected " +
                                        std::to_string(element.count) + " of element " +
                                        shown(element.name) + " with at least " +
                                        std::to_string(element.least_size) + " bytes each");
    }
    sum += element.count * element.least_size;
  }
  report_.declared = vertex().count;
}

int PlySource::face_indices(const Element& element) {
  if (element.name != "face") return -1;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const Property& property = element.properties[i];
    if (property.list && (property.name == "vertex_indices" || property.name == "vertex_index")) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

void PlySource::start_points() {
  const Element& element = vertex();
  std::vector<ScalarType> types;
  std::vector<RecordReader::Field> places;
  std::size_t offset = 0;
  for (const Property& property : element.properties) {
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
  for (std::size_t e = 0; e < vertex_ && !truncated_; ++e) pass_element(elements_[e]);
  const FieldRoles roles = find_roles(header_.fields);
  if (ascii_) {
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
    records_ =
        RecordReader(static_cast<std::size_t>(element.fixed_size), std::move(places), count, swap_);
  }
}

void PlySource::end_early(const Element& element, std::uint64_t done) {
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
    if (swap_) std::reverse(bytes, bytes + sizeof bytes);
    std::memcpy(&tag, bytes, sizeof bytes);
    return static_cast<double>(tag);
  });
}

/// Reads one binary record with lists; false if the file ends before its end.
/// @param values   of the properties that are not lists, if wanted
/// @param indices  of one list, if wanted
bool PlySource::read_list_row(const Element& element, std::vector<double>* values,
                              std::vector<double>* indices, int index_property) {
  std::size_t column = 0;
  for (std::size_t p = 0; p < element.properties.size(); ++p) {
    const Property& property = element.properties[p];
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
  const Element& element = vertex();
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
std::string PlySource::parse_list_line(std::string_view line, const Element& element,
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
    const Property& property = element.properties[i];
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
  const Element& element = vertex();
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
                         ascii_ ? "line " + std::to_string(lines_.line())
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

void PlySource::pass_element(const Element& element) {
  if (element.properties.empty()) return;
  const bool faces = options_.triangles && face_indices(element) >= 0;
  if (ascii_) {
    pass_ascii(element, faces);
  } else {
    pass_binary(element, faces);
  }
}

void PlySource::pass_ascii(const Element& element, bool faces) {
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

void PlySource::pass_binary(const Element& element, bool faces) {
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

// --- writing -----------------------------------------------------------------------------------

class PlySink : public PointSink {
 public:
  PlySink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), encoding_(encoding) {
    if (encoding == CloudEncoding::kCompressed) {
      throw std::invalid_argument(
          "PLY has no compressed encoding, expected binary, ascii or big endian");
    }
    if (!header.count) start_ = out.tellp();
    const FieldRoles roles = find_roles(header.fields);
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      const int index = static_cast<int>(f);
      if (index == roles.packed_color) {
        for (const char* const channel : {"red", "green", "blue"}) {
          add(index, channel, ScalarType::kUint8);
        }
        continue;
      }
      std::string name = header.fields[f].name;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        static const char* const kAxes[] = {"x", "y", "z"};
        static const char* const kNormals[] = {"nx", "ny", "nz"};
        static const char* const kColors[] = {"red", "green", "blue"};
        if (index == roles.position[axis]) name = kAxes[axis];
        if (index == roles.normal[axis]) name = kNormals[axis];
        if (index == roles.color[axis]) name = kColors[axis];
      }
      for (char& c : name) {
        if (is_blank(c) || c == '\n') c = '_';
      }
      add(index, name, header.fields[f].type);
    }
    packed_ = roles.packed_color;
    write_header(header.count);
  }

  void write(const PointBatch& batch) override {
    count_ += batch.count;
    PointBatch columns;
    columns.count = batch.count;
    std::size_t channel = 2;  // of a little-endian 0xRRGGBB
    for (const int source : sources_) {
      FieldView view = batch.fields[static_cast<std::size_t>(source)];
      if (source == packed_) view.data += channel--;
      columns.fields.push_back(view);
    }
    text_.clear();
    if (encoding_ == CloudEncoding::kAscii) {
      for (std::size_t i = 0; i < batch.count; ++i) {
        for (std::size_t c = 0; c < fields_.size(); ++c) {
          if (c > 0) text_ += ' ';
          append_value(text_, columns.fields[c], fields_[c].type, i);
        }
        text_ += '\n';
      }
    } else {
      pack_records(columns, fields_, encoding_ == CloudEncoding::kBigEndian, text_);
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {
    if (header_.count) return;
    const std::ostream::pos_type end = out_.tellp();
    out_.seekp(start_);
    write_header(count_);
    out_.seekp(end);
  }

 private:
  void add(int source, const std::string& name, ScalarType type) {
    PointField field;
    field.name = name;
    field.type = type;
    fields_.push_back(field);
    sources_.push_back(source);
  }

  /// @param count unknown: room is left for the largest number.
  void write_header(std::optional<std::uint64_t> count) {
    constexpr std::size_t kDigits = 20;
    const std::string number = count ? std::to_string(*count) : std::string(kDigits, '0');
    std::string head = "ply\nformat ";
    head += encoding_ == CloudEncoding::kAscii    ? "ascii"
            : encoding_ == CloudEncoding::kBinary ? "binary_little_endian"
                                                  : "binary_big_endian";
    head += " 1.0\n";
    for (const std::string& comment : camber_comments(header_)) head += "comment " + comment + "\n";
    if (!header_.count) head += "comment " + std::string(kDigits - number.size(), '-') + "\n";
    head += "element vertex " + number + "\n";
    for (const PointField& field : fields_) {
      head += std::string("property ") + name_of(field.type) + " " + field.name + "\n";
    }
    head += "end_header\n";
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  std::ostream& out_;
  PointStreamHeader header_;
  CloudEncoding encoding_;
  std::vector<PointField> fields_;
  std::vector<int> sources_;
  int packed_ = -1;
  std::string text_;
  std::uint64_t count_ = 0;
  std::ostream::pos_type start_ = 0;
};

}  // namespace

std::unique_ptr<PointSource> open_ply(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<PlySource>(std::move(file), options);
}

std::unique_ptr<PointSink> make_ply_sink(std::ostream& out, const PointStreamHeader& header,
                                         CloudEncoding encoding) {
  return std::make_unique<PlySink>(out, header, encoding);
}

}  // namespace camber
