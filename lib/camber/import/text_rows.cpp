#include "camber/import/text_rows.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/scene/json_reader.h"

namespace camber {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

}  // namespace

bool parse_number(std::string_view word, double* value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  if (word.empty() || word.front() == '+') return false;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), *value);
  if (error == std::errc::result_out_of_range) {
    // Too small is zero, too large is no number that anyone meant.
    const auto exponent = word.find_first_of("eE");
    if (exponent == std::string_view::npos || word.substr(exponent + 1, 1) != "-") return false;
    *value = 0.0;
    return true;
  }
  return error == std::errc() && end == word.data() + word.size();
}

TextRows::TextRows(const std::filesystem::path& path)
    : file_(path.string()), text_(read_whole_file(path)) {
  int line = 1;
  std::size_t line_start = text_.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0;
  while (line_start < text_.size()) {
    std::size_t line_end = text_.find('\n', line_start);
    if (line_end == std::string::npos) line_end = text_.size();
    TextRow row;
    row.line = line;
    std::size_t i = line_start;
    while (i < line_end) {
      if (is_blank(text_[i])) {
        ++i;
        continue;
      }
      const std::size_t start = i;
      while (i < line_end && !is_blank(text_[i])) {
        if (text_[i] == '\0') {
          throw InputError(file_, fmt::format("line {}, column {}", line, i - line_start + 1),
                           "found a null byte, expected text");
        }
        ++i;
      }
      row.words.push_back({std::string_view(text_).substr(start, i - start),
                           static_cast<int>(start - line_start + 1)});
    }
    if (!row.words.empty()) rows_.push_back(std::move(row));
    line_start = line_end + 1;
    ++line;
  }
}

void TextRows::fail(const TextRow& row, const TextWord& word, const std::string& reason) const {
  throw InputError(file_, fmt::format("line {}, column {}", row.line, word.column), reason);
}

void TextRows::fail(const TextRow& row, const std::string& reason) const {
  throw InputError(file_, fmt::format("line {}", row.line), reason);
}

double TextRows::number(const TextRow& row, const TextWord& word,
                        const std::string& expectation) const {
  double value = 0.0;
  if (!parse_number(word.text, &value) || !std::isfinite(value)) {
    fail(row, word, fmt::format("found '{}', expected {}", printable(word.text), expectation));
  }
  return value;
}

int TextRows::integer(const TextRow& row, const TextWord& word, int low, int high,
                      const std::string& expectation) const {
  double value = 0.0;
  if (!parse_number(word.text, &value) || !(value >= low && value <= high) ||
      value != std::floor(value)) {
    fail(row, word, fmt::format("found '{}', expected {}", printable(word.text), expectation));
  }
  return static_cast<int>(value);
}

}  // namespace camber
