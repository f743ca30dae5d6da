#include "camber/cloud/number_text.h"

#include <charconv>
#include <cmath>
#include <limits>

namespace camber {
namespace {

constexpr double kPowersOfTen[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                   1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                   1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

bool is_digit(char c) { return static_cast<unsigned char>(c - '0') < 10; }

bool starts_with_word(const char* p, const char* end, std::string_view word) {
  if (static_cast<std::size_t>(end - p) < word.size()) return false;
  for (std::size_t i = 0; i < word.size(); ++i) {
    if ((p[i] | 0x20) != word[i]) return false;
  }
  return true;
}

ParsedNumber parse_special(const char* p, const char* end, bool negative) {
  ParsedNumber out;
  if (starts_with_word(p, end, "nan")) {
    out.value = std::numeric_limits<double>::quiet_NaN();
    out.end = p + 3;
    // C prints some as nan(...) or, on Windows, as nan(ind).
    if (out.end < end && *out.end == '(') {
      for (const char* q = out.end; q < end && q < out.end + 32; ++q) {
        if (*q == ')') {
          out.end = q + 1;
          break;
        }
      }
    }
  } else if (starts_with_word(p, end, "inf")) {
    out.value = negative ? -std::numeric_limits<double>::infinity()
                         : std::numeric_limits<double>::infinity();
    out.end = p + (starts_with_word(p, end, "infinity") ? 8 : 3);
  }
  return out;
}

}  // namespace

ParsedNumber parse_number(const char* begin, const char* end) {
  const char* p = begin;
  bool negative = false;
  if (p < end && (*p == '-' || *p == '+')) negative = *p++ == '-';
  const char* const first = p;
  std::uint64_t mantissa = 0;
  while (p < end && is_digit(*p)) mantissa = mantissa * 10 + static_cast<unsigned>(*p++ - '0');
  std::ptrdiff_t digits = p - first;
  int exponent = 0;
  ParsedNumber out;
  out.whole = true;
  if (p < end && *p == '.') {
    out.whole = false;
    const char* const point = ++p;
    while (p < end && is_digit(*p)) mantissa = mantissa * 10 + static_cast<unsigned>(*p++ - '0');
    if (p - point > 1000000) return {};  // no number has a million decimals
    exponent = -static_cast<int>(p - point);
    digits += p - point;
  }
  if (digits == 0) return parse_special(first, end, negative);
  if (p < end && (*p == 'e' || *p == 'E')) {
    const char* q = p + 1;
    bool negative_exponent = false;
    if (q < end && (*q == '-' || *q == '+')) negative_exponent = *q++ == '-';
    if (q < end && is_digit(*q)) {
      int written = 0;
      while (q < end && is_digit(*q)) {
        written = written < 100000000 ? written * 10 + (*q - '0') : written;
        ++q;
      }
      exponent += negative_exponent ? -written : written;
      out.whole = false;
      p = q;
    }
  }
  out.end = p;
  // Both the digits and the power of ten are exact in a double: one rounding, the right one
  // (Clinger, "How to read floating point numbers accurately", PLDI 1990).
  if (digits <= 18 && mantissa <= (std::uint64_t{1} << 53) && exponent >= -22 && exponent <= 22) {
    const double value = static_cast<double>(mantissa);
    out.value = exponent < 0 ? value / kPowersOfTen[-exponent] : value * kPowersOfTen[exponent];
    if (negative) out.value = -out.value;
    return out;
  }
  double value = 0.0;
  const std::from_chars_result result = std::from_chars(first, p, value);
  if (result.ec == std::errc::result_out_of_range) {
    // Which of the two it is shows in the position of the first digit that counts.
    std::ptrdiff_t leading = 0;
    bool point_seen = false, counts = false;
    for (const char* q = first; q < p && *q != 'e' && *q != 'E'; ++q) {
      if (*q == '.') {
        point_seen = true;
      } else if (!counts && *q == '0') {
        leading -= point_seen ? 1 : 0;
      } else {
        counts = true;
        leading += point_seen ? 0 : 1;
      }
    }
    int written = 0;
    for (const char* q = first; q < p; ++q) {
      if (*q == 'e' || *q == 'E') {
        const bool down = q[1] == '-';
        for (q += (q[1] == '-' || q[1] == '+') ? 2 : 1; q < p; ++q) {
          written = written < 100000000 ? written * 10 + (*q - '0') : written;
        }
        if (down) written = -written;
      }
    }
    value = leading + written > 0 ? std::numeric_limits<double>::infinity() : 0.0;
  } else if (result.ec != std::errc()) {
    return {};
  }
  out.value = negative ? -value : value;
  return out;
}

bool parse_unsigned(std::string_view text, std::uint64_t& value) {
  const std::from_chars_result result =
      std::from_chars(text.data(), text.data() + text.size(), value);
  return !text.empty() && result.ec == std::errc() && result.ptr == text.data() + text.size();
}

namespace {
template <typename T>
void append(std::string& out, T value) {
  char text[40];
  const std::to_chars_result result = std::to_chars(text, text + sizeof text, value);
  out.append(text, result.ptr);
}
template <typename T>
void append_float(std::string& out, T value) {
  if (std::isnan(value)) {
    out += "nan";  // without the sign that some NaNs carry
  } else {
    append(out, value);
  }
}
}  // namespace

void append_number(std::string& out, double value) { append_float(out, value); }
void append_number(std::string& out, float value) { append_float(out, value); }
void append_number(std::string& out, std::int64_t value) { append(out, value); }
void append_number(std::string& out, std::uint64_t value) { append(out, value); }

std::string_view next_word(std::string_view& line) {
  std::size_t start = 0;
  while (start < line.size() && is_blank(line[start])) ++start;
  std::size_t end = start;
  while (end < line.size() && !is_blank(line[end])) ++end;
  const std::string_view word = line.substr(start, end - start);
  line.remove_prefix(end);
  return word;
}

}  // namespace camber
