#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace camber {

/// One word of a text file and where it stands.
struct TextWord {
  std::string_view text;
  int column = 0;  ///< byte in its line, from 1
};

/// One line that is not blank.
struct TextRow {
  int line = 0;  ///< from 1
  std::vector<TextWord> words;
};

/// A text file as words divided by blanks; blank lines are left out, the last line may lack its
/// end, Windows line ends and a byte order mark are taken.
class TextRows {
 public:
  /// @throws InputError if the file cannot be read or holds a null byte.
  explicit TextRows(const std::filesystem::path& path);
  TextRows(const TextRows&) = delete;  // the words point into the text
  TextRows& operator=(const TextRows&) = delete;

  const std::string& file() const { return file_; }
  const std::vector<TextRow>& rows() const { return rows_; }

  /// @throws InputError "file: line L, column C: reason".
  [[noreturn]] void fail(const TextRow& row, const TextWord& word, const std::string& reason) const;
  /// The same for a whole line.
  [[noreturn]] void fail(const TextRow& row, const std::string& reason) const;

  /// A finite number, or an InputError "found 'word', expected (expectation)".
  double number(const TextRow& row, const TextWord& word, const std::string& expectation) const;
  /// An integer in [low, high].
  int integer(const TextRow& row, const TextWord& word, int low, int high,
              const std::string& expectation) const;

 private:
  std::string file_;
  std::string text_;
  std::vector<TextRow> rows_;
};

/// Whether a word reads as a number from its first to its last character.
bool parse_number(std::string_view word, double* value);

}  // namespace camber
