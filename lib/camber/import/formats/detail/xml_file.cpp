#include "camber/import/formats/detail/xml_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/text_rows.h"

namespace camber {
namespace {

long line_at(const std::string& text, std::ptrdiff_t offset) {
  const auto end =
      text.begin() + std::min<std::ptrdiff_t>(std::max<std::ptrdiff_t>(offset, 0),
                                              static_cast<std::ptrdiff_t>(text.size()));
  return 1 + std::count(text.begin(), end, '\n');
}

}  // namespace

XmlFile XmlFile::read(const std::filesystem::path& path) {
  return parse(read_whole_file(path), path.string());
}

XmlFile XmlFile::parse(std::string text, const std::string& file) {
  XmlFile out;
  out.file_ = file;
  out.text_ = std::move(text);
  const pugi::xml_parse_result result =
      out.document_->load_buffer(out.text_.data(), out.text_.size());
  if (!result) {
    throw InputError(file, fmt::format("line {}", line_at(out.text_, result.offset)),
                     fmt::format("found damaged XML ({}), expected a complete document",
                                 printable(result.description(), 80)));
  }
  return out;
}

void XmlFile::fail(const pugi::xml_node& at, const std::string& reason) const {
  throw InputError(file_, fmt::format("line {}", line_at(text_, at.offset_debug())), reason);
}

double XmlFile::number(const pugi::xml_node& at, const char* text, const char* name) const {
  std::string word = text;
  word.erase(0, word.find_first_not_of(" \t\r\n"));
  word.erase(word.find_last_not_of(" \t\r\n") + 1);
  double value = 0.0;
  if (!parse_number(word, &value) || !std::isfinite(value)) {
    fail(at, fmt::format("found '{}' for {}, expected a number", printable(word), name));
  }
  return value;
}

double XmlFile::child_number(const pugi::xml_node& parent, const char* name) const {
  return number(parent, parent.child_value(name), name);
}

double XmlFile::attribute_number(const pugi::xml_node& element, const char* name) const {
  return number(element, element.attribute(name).value(), name);
}

}  // namespace camber
