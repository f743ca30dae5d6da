#include "camber/import/formats/detail/document.h"

#include <fmt/format.h>

#include <cctype>
#include <cmath>
#include <pugixml.hpp>
#include <regex>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/xml_file.h"
#include "camber/import/text_rows.h"

namespace camber {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxNumbers = 1000;
constexpr int kMaxDepth = 32;

/// OpenCV's header "%YAML:1.0" is no directive of YAML, and its parser takes "key:value".
std::string without_opencv_quirks(std::string text) {
  const std::size_t start = text.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0;
  if (text.compare(start, 5, "%YAML") != 0) return text;
  for (std::size_t i = start; i < text.size() && text[i] != '\n'; ++i) text[i] = ' ';
  std::istringstream lines(text);
  std::string out;
  static const std::regex tight("^( *[A-Za-z_][A-Za-z0-9_.]*):([^ \\t\\r].*)$");
  for (std::string line; std::getline(lines, line);) {
    std::smatch parts;
    // A regex walks its text by recursion: only lines of the length that people write.
    if (line.size() < 400 && std::regex_match(line, parts, tight)) {
      out += parts[1].str() + ": " + parts[2].str();
    } else {
      out += line;
    }
    out += '\n';
  }
  return out;
}

YAML::Node from_xml(const pugi::xml_node& xml, const XmlFile& file, int depth) {
  if (depth > kMaxDepth) file.fail(xml, "found elements nested deeper than 32");
  if (xml.first_child().type() == pugi::node_element) {
    const bool list = std::string(xml.first_child().name()) == "_";
    YAML::Node out(list ? YAML::NodeType::Sequence : YAML::NodeType::Map);
    for (const pugi::xml_node& child : xml.children()) {
      if (child.type() != pugi::node_element) continue;
      if (list) {
        out.push_back(from_xml(child, file, depth + 1));
      } else {
        out[std::string(child.name())] = from_xml(child, file, depth + 1);
      }
    }
    return out;
  }
  const std::string text = xml.text().get();
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first == std::string::npos) return YAML::Node("");
  if (text[first] == '"')
    return YAML::Node(text.substr(first, text.find_last_not_of(" \t\r\n") + 1 - first));
  YAML::Node list(YAML::NodeType::Sequence);
  std::istringstream words(text);
  for (std::string word; words >> word;) list.push_back(word);
  return list.size() == 1 ? YAML::Node(list[0]) : list;
}

void gather(const Document& document, const YAML::Node& node, const std::string& expectation,
            int depth, std::vector<double>* out) {
  if (!node.IsSequence() || depth > 2) document.expected(node, expectation);
  if (out->size() + node.size() > kMaxNumbers) document.expected(node, expectation);
  for (const YAML::Node& item : node) {
    if (item.IsSequence()) {
      gather(document, item, expectation, depth + 1, out);
    } else {
      out->push_back(document.number(item, expectation));
    }
  }
}

}  // namespace

Document Document::read(const std::filesystem::path& path) {
  return parse(read_whole_file(path, kMaxBytes), path.string());
}

Document Document::parse(const std::string& text, const std::string& file) {
  Document out;
  out.file_ = file;
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string::npos)
    throw InputError(file, "found an empty file, expected values by name");
  if (text.find('\0') != std::string::npos) {
    throw InputError(file, fmt::format("byte {}", text.find('\0')),
                     "found a null byte, expected text");
  }
  if (text[first] == '<') {
    const XmlFile xml = XmlFile::parse(text, file);
    const pugi::xml_node root = xml.root();
    if (std::string(root.name()) != "opencv_storage") {
      xml.fail(root, fmt::format("found <{}>, expected <opencv_storage>", printable(root.name())));
    }
    out.root_ = from_xml(root, xml, 0);
    return out;
  }
  try {
    out.root_ = YAML::Load(without_opencv_quirks(text));
  } catch (const YAML::Exception& error) {
    throw InputError(file,
                     fmt::format("line {}, column {}", error.mark.line + 1, error.mark.column + 1),
                     fmt::format("found no YAML or JSON ({}), expected values by name",
                                 printable(error.msg, 80)));
  }
  return out;
}

void Document::fail(const YAML::Node& at, const std::string& reason) const {
  const YAML::Mark mark = at.IsDefined() ? at.Mark() : YAML::Mark::null_mark();
  if (mark.is_null()) throw InputError(file_, reason);
  throw InputError(file_, fmt::format("line {}, column {}", mark.line + 1, mark.column + 1),
                   reason);
}

void Document::expected(const YAML::Node& at, const std::string& expectation) const {
  const std::string found = !at.IsDefined() || at.IsNull() ? "nothing"
                            : at.IsScalar()                ? "'" + printable(at.Scalar()) + "'"
                            : at.IsSequence()              ? fmt::format("{} values", at.size())
                                                           : "an object";
  fail(at, fmt::format("found {}, expected {}", found, expectation));
}

double Document::number(const YAML::Node& node, const std::string& expectation) const {
  double value = 0.0;
  if (!node.IsScalar() || !parse_number(text_of(node), &value) || !std::isfinite(value)) {
    expected(node, expectation);
  }
  return value;
}

int Document::integer(const YAML::Node& node, int low, int high,
                      const std::string& expectation) const {
  const double value = number(node, expectation);
  if (!(value >= low && value <= high) || value != std::floor(value)) expected(node, expectation);
  return static_cast<int>(value);
}

std::vector<double> Document::numbers(const YAML::Node& node,
                                      const std::string& expectation) const {
  std::vector<double> out;
  if (!node.IsMap()) {
    gather(*this, node, expectation, 0, &out);
    return out;
  }
  const auto data = find_by_plain_name(node, {"data"});
  if (!data) expected(node, expectation);
  if (data->IsScalar()) return {number(*data, expectation)};
  gather(*this, *data, expectation, 0, &out);
  const auto rows = find_by_plain_name(node, {"rows"}),
             columns = find_by_plain_name(node, {"cols"});
  if (rows && columns) {
    const int most = static_cast<int>(kMaxNumbers);
    const long count = static_cast<long>(integer(*rows, 0, most, "a number of rows")) *
                       integer(*columns, 0, most, "a number of columns");
    if (count != static_cast<long>(out.size())) {
      fail(*data, fmt::format("found {} numbers, expected rows * cols = {}", out.size(), count));
    }
  }
  return out;
}

std::string plain_name(const std::string& name) {
  std::string out;
  for (const char c : name) {
    if (c != '_' && c != '-' && c != '.' && c != ' ') {
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
  }
  return out;
}

std::optional<YAML::Node> find_by_plain_name(const YAML::Node& map,
                                             const std::vector<std::string>& names) {
  if (!map.IsMap()) return std::nullopt;
  for (const std::string& name : names) {
    for (const auto& entry : map) {
      if (entry.first.IsScalar() && plain_name(entry.first.Scalar()) == name &&
          !entry.second.IsNull()) {
        return entry.second;
      }
    }
  }
  return std::nullopt;
}

std::string text_of(const YAML::Node& node) {
  if (!node.IsScalar()) return {};
  std::string text = node.Scalar();
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"')
    text = text.substr(1, text.size() - 2);
  return text;
}

}  // namespace camber
