#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace camber {

/// One line of a table, its fields without blanks and quotes around them.
struct DelimitedLine {
  int line = 0;  ///< from 1
  std::vector<std::string_view> fields;
};

/// A text file as fields between separators; lines that are blank or begin with '#' are kept apart.
/// A quoted field may hold separators but no line end.
class DelimitedLines {
 public:
  /// @throws InputError if the file cannot be read, holds a null byte or a line of more than 1000
  ///         fields.
  DelimitedLines(const std::filesystem::path& path, char separator);
  DelimitedLines(const DelimitedLines&) = delete;  // the fields point into the text
  DelimitedLines& operator=(const DelimitedLines&) = delete;

  const std::string& file() const { return file_; }
  const std::vector<DelimitedLine>& lines() const { return lines_; }
  const std::vector<std::string_view>& comments() const { return comments_; }  ///< without the '#'

  /// @throws InputError "file: line L, field F: reason".
  [[noreturn]] void fail(const DelimitedLine& line, std::size_t field,
                         const std::string& reason) const;
  [[noreturn]] void fail(const DelimitedLine& line, const std::string& reason) const;

  /// A field's text with the decimal sign as a point: where ';' separates, it may be a comma.
  std::string decimal(std::string text) const;
  /// decimal() of a field. A finite number, or an InputError "found
  /// 'word', expected (expectation)".
  double number(const DelimitedLine& line, std::size_t field, const std::string& expectation) const;
  int integer(const DelimitedLine& line, std::size_t field, int low, int high,
              const std::string& expectation) const;

 private:
  std::string file_, text_;
  char separator_;
  std::vector<DelimitedLine> lines_;
  std::vector<std::string_view> comments_;
};

/// The separator of a table by its first line that is no comment: ',', ';', tab, or ' '.
char separator_of(const std::string& text);

}  // namespace camber
