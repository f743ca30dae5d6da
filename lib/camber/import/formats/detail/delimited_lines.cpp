#include "camber/import/formats/detail/delimited_lines.h"

#include <fmt/format.h>

#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/text_rows.h"

namespace camber {
namespace {

constexpr std::size_t kMaxFields = 1000;

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  text = text.substr(first, text.find_last_not_of(" \t\r") + 1 - first);
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"') {
    text = text.substr(1, text.size() - 2);
  }
  return text;
}

}  // namespace

DelimitedLines::DelimitedLines(const std::filesystem::path& path, char separator)
    : file_(path.string()), text_(read_whole_file(path)), separator_(separator) {
  int number = 0;
  std::size_t start = text_.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0;
  while (start < text_.size()) {
    ++number;
    std::size_t end = text_.find('\n', start);
    if (end == std::string::npos) end = text_.size();
    const std::string_view line = std::string_view(text_).substr(start, end - start);
    start = end + 1;
    if (line.find('\0') != std::string_view::npos) {
      throw InputError(file_, fmt::format("line {}", number), "found a null byte, expected text");
    }
    const std::string_view content = trimmed(line);
    if (content.empty()) continue;
    if (content.front() == '#') {
      comments_.push_back(content.substr(1));
      continue;
    }
    DelimitedLine out;
    out.line = number;
    bool quoted = false;
    std::size_t from = 0;
    for (std::size_t i = 0; i <= line.size(); ++i) {
      if (i < line.size() && line[i] == '"') quoted = !quoted;
      const bool ends = i == line.size() || (line[i] == separator && !quoted);
      if (!ends) continue;
      const std::string_view field = trimmed(line.substr(from, i - from));
      // Blanks as separators may be several.
      if (separator != ' ' || !field.empty()) out.fields.push_back(field);
      from = i + 1;
      if (out.fields.size() > kMaxFields) {
        throw InputError(file_, fmt::format("line {}", number),
                         "found more than 1000 fields, expected a table");
      }
    }
    if (!out.fields.empty()) lines_.push_back(std::move(out));
  }
}

void DelimitedLines::fail(const DelimitedLine& line, std::size_t field,
                          const std::string& reason) const {
  throw InputError(file_, fmt::format("line {}, field {}", line.line, field + 1), reason);
}

void DelimitedLines::fail(const DelimitedLine& line, const std::string& reason) const {
  throw InputError(file_, fmt::format("line {}", line.line), reason);
}

std::string DelimitedLines::decimal(std::string text) const {
  const std::size_t comma = separator_ == ';' ? text.find(',') : std::string::npos;
  if (comma != std::string::npos && text.find_first_of(",.", comma + 1) == std::string::npos &&
      text.find('.') == std::string::npos) {
    text[comma] = '.';
  }
  return text;
}

double DelimitedLines::number(const DelimitedLine& line, std::size_t field,
                              const std::string& expectation) const {
  if (field >= line.fields.size()) {
    fail(line, fmt::format("found {} fields, expected {} in field {}", line.fields.size(),
                           expectation, field + 1));
  }
  double value = 0.0;
  const std::string text = decimal(std::string(line.fields[field]));
  if (!parse_number(text, &value) || !std::isfinite(value)) {
    fail(line, field,
         fmt::format("found '{}', expected {}", printable(line.fields[field]), expectation));
  }
  return value;
}

int DelimitedLines::integer(const DelimitedLine& line, std::size_t field, int low, int high,
                            const std::string& expectation) const {
  const double value = number(line, field, expectation);
  if (!(value >= low && value <= high) || value != std::floor(value)) {
    fail(line, field,
         fmt::format("found '{}', expected {}", printable(line.fields[field]), expectation));
  }
  return static_cast<int>(value);
}

char separator_of(const std::string& text) {
  std::size_t start = 0;
  while (start < text.size()) {
    std::size_t end = text.find('\n', start);
    if (end == std::string::npos) end = text.size();
    const std::string_view line = trimmed(std::string_view(text).substr(start, end - start));
    start = end + 1;
    if (line.empty() || line.front() == '#') continue;
    for (const char c : {';', ',', '\t'}) {
      if (line.find(c) != std::string_view::npos) return c;
    }
    return ' ';
  }
  return ',';
}

}  // namespace camber
