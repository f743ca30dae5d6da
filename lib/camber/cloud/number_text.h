#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace camber {

/// One number of a text file.
struct ParsedNumber {
  double value = 0.0;
  bool whole = false;         ///< written as an integer: a sign and digits only
  const char* end = nullptr;  ///< behind the number; nullptr if there is none
};

/// Parses one number at the start of [begin, end): a sign, digits with an optional point and
/// exponent, or nan, inf, infinity in any case. Correctly rounded; independent of the locale.
/// Numbers beyond the range of double become infinite or zero.
ParsedNumber parse_number(const char* begin, const char* end);

/// Parses an unsigned whole number that is all of `text`; false if it is not one below 2^64.
bool parse_unsigned(std::string_view text, std::uint64_t& value);

/// Appends the shortest text that reads back as the same number; nan, inf, -inf for those.
void append_number(std::string& out, double value);
void append_number(std::string& out, float value);
void append_number(std::string& out, std::int64_t value);
void append_number(std::string& out, std::uint64_t value);

inline bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

/// Takes the next word from the front of `line`, blanks skipped; empty at the end.
std::string_view next_word(std::string_view& line);

}  // namespace camber
