#include "camber/cloud/detail/ply_header.h"

#include <algorithm>
#include <optional>
#include <set>

#include "camber/cloud/number_text.h"

namespace camber::detail {
namespace {

constexpr std::size_t kHeaderLine = 1 << 16;  // bytes
constexpr std::size_t kMostProperties = 4096;
constexpr std::size_t kMostElements = 4096;

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

class PlyHeaderReader {
 public:
  PlyHeaderReader(FileReader& file, LineReader& lines, bool lenient,
                  const std::function<void(std::string_view)>& comment, ReadReport* report)
      : file_(file), lines_(lines), lenient_(lenient), comment_(comment), report_(report) {}

  PlyHeader read();

 private:
  void read_first_line();
  void read_format(std::string_view rest);
  void read_element(std::string_view line, std::string_view rest);
  void read_property(std::string_view rest);
  void name_property();
  void check_sizes();

  FileReader& file_;
  LineReader& lines_;
  bool lenient_;
  const std::function<void(std::string_view)>& comment_;
  ReadReport* report_;
  PlyHeader header_;
  bool format_seen_ = false;
  std::set<std::string> names_;  // of the last element's properties
};

void PlyHeaderReader::read_first_line() {
  std::string_view line;
  // The first line shows how lines end: \n, \r\n or, on old Macs, \r.
  file_.fill(16);
  const std::string_view start(file_.text(), std::min<std::size_t>(file_.available(), 16));
  const std::size_t end = start.find_first_of("\r\n");
  if (end != std::string_view::npos && start[end] == '\r' &&
      (end + 1 == start.size() || start[end + 1] != '\n')) {
    lines_.set_carriage_return_ends();
  }
  if (!lines_.next(line, kHeaderLine)) file_.fail_at(0, "found an empty file, expected 'ply'");
  std::string_view rest = line;
  if (next_word(rest) != "ply" || !next_word(rest).empty()) {
    lines_.fail("found " + shown(line) + ", expected 'ply'");
  }
}

void PlyHeaderReader::read_format(std::string_view rest) {
  const std::string_view format = next_word(rest), version = next_word(rest);
  if (format_seen_) lines_.fail("found a second format line, expected one");
  format_seen_ = true;
  if (format == "ascii") {
    header_.ascii = true;
    report_->encoding = "ascii";
  } else if (format == "binary_little_endian") {
    report_->encoding = "binary little endian";
  } else if (format == "binary_big_endian") {
    header_.big_endian = true;
    report_->encoding = "binary big endian";
  } else {
    lines_.fail("found format " + shown(format) +
                ", expected ascii, binary_little_endian or binary_big_endian");
  }
  if (version != "1.0") lines_.fail("found version " + shown(version) + ", expected 1.0");
}

void PlyHeaderReader::read_element(std::string_view line, std::string_view rest) {
  PlyElement element;
  element.name = std::string(next_word(rest));
  const std::string_view count = next_word(rest);
  if (element.name.empty() || !parse_unsigned(count, element.count) || !next_word(rest).empty()) {
    lines_.fail("found " + shown(line) + ", expected 'element NAME COUNT'");
  }
  for (const PlyElement& other : header_.elements) {
    if (other.name == element.name) {
      lines_.fail("found a second element " + shown(element.name) + ", expected one");
    }
  }
  if (header_.elements.size() == kMostElements) {
    lines_.fail("found more than " + std::to_string(kMostElements) + " elements");
  }
  names_.clear();
  header_.elements.push_back(std::move(element));
}

void PlyHeaderReader::read_property(std::string_view rest) {
  PlyProperty property;
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
  PlyElement& element = header_.elements.back();
  if (element.properties.size() == kMostProperties) {
    lines_.fail("found more than " + std::to_string(kMostProperties) + " properties");
  }
  const std::uint64_t size = size_of(property.list ? property.count_type : property.type);
  element.fixed_size += size;
  element.has_lists = element.has_lists || property.list;
  element.properties.push_back(std::move(property));
}

/// Property names are unique in an element.
void PlyHeaderReader::name_property() {
  PlyProperty& property = header_.elements.back().properties.back();
  if (!names_.insert(property.name).second) {
    if (!lenient_) {
      lines_.fail("found property " + shown(property.name) + " twice, expected different names");
    }
    report_->notes.push_back("the second property '" + property.name + "' has a number added");
    do {
      property.name += "_" + std::to_string(names_.size());
    } while (!names_.insert(property.name).second);
  }
}

void PlyHeaderReader::check_sizes() {
  const std::uint64_t rest = file_.remaining();
  std::uint64_t sum = 0;
  lines_.release();
  for (PlyElement& element : header_.elements) {
    // A text value takes a digit and a separator, but for the last of the file.
    element.least_size = header_.ascii ? 2 * element.properties.size() : element.fixed_size;
    if (element.properties.empty()) continue;  // such an element takes no room, whatever its count
    const std::uint64_t fitting = (rest + 1) / element.least_size;
    if (element.count > fitting || sum + element.count * element.least_size > rest + 1) {
      if (lenient_) continue;
      file_.fail_at(file_.size(), "found the end of the file, expected " +
                                      std::to_string(element.count) + " of element " +
                                      shown(element.name) + " with at least " +
                                      std::to_string(element.least_size) + " bytes each");
    }
    sum += element.count * element.least_size;
  }
  report_->declared = header_.elements[header_.vertex].count;
}

PlyHeader PlyHeaderReader::read() {
  read_first_line();
  std::string_view line, rest;
  while (true) {
    if (!lines_.next(line, kHeaderLine)) {
      file_.fail_at(file_.size(), "found the end of the file, expected end_header");
    }
    if (file_.position() > (std::uint64_t{1} << 24)) {
      lines_.fail("found a header of more than 16 MB, expected end_header before");
    }
    rest = line;
    const std::string_view key = next_word(rest);
    if (key == "comment" || key == "obj_info") {
      if (key == "comment") comment_(rest);
    } else if (key == "format") {
      read_format(rest);
    } else if (key == "element") {
      read_element(line, rest);
    } else if (key == "property") {
      if (header_.elements.empty()) lines_.fail("found a property, expected an element before it");
      read_property(rest);
      name_property();
    } else if (key == "end_header") {
      break;
    } else if (!key.empty()) {
      lines_.fail("found " + shown(key) +
                  ", expected format, comment, obj_info, element, property or end_header");
    }
  }
  if (!format_seen_) lines_.fail("found end_header, expected a format line before it");
  const auto found = std::find_if(header_.elements.begin(), header_.elements.end(),
                                  [](const PlyElement& e) { return e.name == "vertex"; });
  if (found == header_.elements.end()) {
    lines_.fail("found no element 'vertex', expected one with x, y and z");
  }
  header_.vertex = static_cast<std::size_t>(found - header_.elements.begin());
  for (const PlyElement& element : header_.elements) {
    if (element.name == "face") report_->faces = element.count;
  }
  check_sizes();
  return std::move(header_);
}

}  // namespace

PlyHeader read_ply_header(FileReader& file, LineReader& lines, bool lenient,
                          const std::function<void(std::string_view)>& comment,
                          ReadReport* report) {
  return PlyHeaderReader(file, lines, lenient, comment, report).read();
}

int face_indices(const PlyElement& element) {
  if (element.name != "face") return -1;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    if (property.list && (property.name == "vertex_indices" || property.name == "vertex_index")) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

}  // namespace camber::detail
