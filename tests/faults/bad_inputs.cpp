#include "faults/bad_inputs.h"

#include <algorithm>
#include <cctype>

namespace camber::test {
namespace {

constexpr const char* kNumbers[] = {"nan",
                                    "inf",
                                    "-inf",
                                    "1e308",
                                    "-1e308",
                                    "1e309",
                                    "1e-320",
                                    "-1",
                                    "0",
                                    "-0",
                                    "2147483648",
                                    "4294967296",
                                    "1e10",
                                    "-2147483649",
                                    "1e19",
                                    "9223372036854775808",
                                    "99999999999999999999999",
                                    "1e155",
                                    "1e-155",
                                    "0.5",
                                    "3"};
constexpr const char* kValues[] = {
    "null", "true",   "{}",          "[]",     "\"\"",       "\"x\"",
    "[1]",  "[[]]",   "{\"a\":1}",   "-1",     "1e308",      "1e400",
    "0",    "1e-320", "\"\\u0000\"", "[null]", "4294967296", "-9223372036854775809"};
constexpr const char* kWords[] = {"nan",
                                  "inf",
                                  "-inf",
                                  "1e308",
                                  "-1e308",
                                  "1e309",
                                  "1e-320",
                                  "-1",
                                  "0",
                                  "",
                                  " ",
                                  "x",
                                  "1,2",
                                  "2147483648",
                                  "-2147483649",
                                  "99999999999999999999",
                                  "0:1000000000",
                                  "5:1",
                                  "1,,2",
                                  "nan,nan,nan",
                                  "inf,0,0",
                                  "1e308,1e308,1e308",
                                  "0,0,0",
                                  "0,0,1e-320",
                                  "cloud.ply",
                                  "scene",
                                  "result",
                                  "surface",
                                  "line.xyz",
                                  "none.ply",
                                  "none/none",
                                  "/dev/null",
                                  "..",
                                  "%s%n",
                                  "a\nb",
                                  "\xff\xfe",
                                  "--",
                                  "-",
                                  "1e155",
                                  "1e-155",
                                  "EPSG:0",
                                  "x,y",
                                  "x,y,z,z",
                                  "0x10",
                                  "1e",
                                  "+5"};
constexpr std::size_t kHeader = 400;  // bytes

bool is_text(const std::string& bytes) {
  return std::all_of(
      bytes.begin(), bytes.begin() + std::min<std::size_t>(bytes.size(), 200),
      [](unsigned char c) { return c >= 0x20 || c == '\n' || c == '\r' || c == '\t'; });
}

/// Where to damage: half the time in the header.
std::size_t place(const std::string& bytes, Draws& draws) {
  const std::size_t size = std::max<std::size_t>(1, bytes.size());
  return draws.below(draws.chance(0.5) ? std::min(size, kHeader) : size);
}

/// Bounds of a token around or behind a place that `belongs` accepts all characters of.
template <typename Belongs>
std::pair<std::size_t, std::size_t> token(const std::string& text, std::size_t at,
                                          Belongs belongs) {
  while (at < text.size() && !belongs(text[at])) ++at;
  std::size_t begin = at, end = at;
  while (begin > 0 && belongs(text[begin - 1])) --begin;
  while (end < text.size() && belongs(text[end])) ++end;
  return {begin, end};
}

void replace_number(std::string& text, Draws& draws) {
  const auto [begin, end] = token(text, place(text, draws), [](char c) {
    return std::isdigit(static_cast<unsigned char>(c)) || c == '.' || c == '-';
  });
  text.replace(begin, end - begin, draws.one_of(kNumbers));
}

/// The value behind a colon, up to the next comma or bracket.
void replace_value(std::string& text, Draws& draws) {
  std::size_t begin = text.find_first_of(":,[", place(text, draws));
  if (begin == std::string::npos) begin = text.find(':');
  if (begin == std::string::npos) return replace_number(text, draws);
  ++begin;
  std::size_t end = begin, depth = 0;
  for (; end < text.size(); ++end) {
    const char c = text[end];
    if (c == '[' || c == '{') ++depth;
    if (depth == 0 && (c == ',' || c == ']' || c == '}' || c == '\n')) break;
    if (depth > 0 && (c == ']' || c == '}')) --depth;
  }
  text.replace(begin, end - begin, draws.one_of(kValues));
}

void change_line(std::string& text, Draws& draws) {
  const auto [begin, end] = token(text, place(text, draws), [](char c) { return c != '\n'; });
  const std::string line = text.substr(begin, end - begin + 1);
  if (draws.chance(0.5)) {
    text.erase(begin, line.size());
  } else {
    text.insert(begin, line);
  }
}

void change_text(std::string& text, Draws& draws) {
  switch (draws.below(5)) {
    case 0:
    case 1:
      return replace_number(text, draws);
    case 2:
      return replace_value(text, draws);
    case 3:
      return change_line(text, draws);
    default:
      text.insert(std::min(place(text, draws), text.size()), std::string(100000, '['));
  }
}

void change_bytes(std::string& bytes, Draws& draws) {
  const std::size_t at = std::min(place(bytes, draws), bytes.size());
  switch (draws.below(6)) {
    case 0:
      bytes.resize(at);
      return;
    case 1:
      bytes.insert(at, 1 + draws.below(9), static_cast<char>(draws.below(256)));
      return;
    case 2:
      bytes.erase(at, 1 + draws.below(9));
      return;
    case 3:
      bytes.replace(at, std::min<std::size_t>(4, bytes.size() - at), 4, '\xff');
      return;
    default:
      for (std::size_t i = 0, count = 1 + draws.below(8); i < count && !bytes.empty(); ++i) {
        bytes[std::min(place(bytes, draws), bytes.size() - 1)] ^=
            static_cast<char>(1 << draws.below(8));
      }
  }
}

}  // namespace

std::string damaged(const std::string& bytes, Draws& draws) {
  if (draws.chance(0.02)) return "";
  std::string out = bytes;
  const bool text = is_text(bytes);
  for (std::size_t i = 0, count = 1 + draws.below(3); i < count; ++i) {
    if (text && draws.chance(0.8)) {
      change_text(out, draws);
    } else {
      change_bytes(out, draws);
    }
  }
  return out;
}

std::vector<std::string> mistyped(std::vector<std::string> arguments,
                                  const std::vector<std::string>& options, Draws& draws) {
  for (std::size_t i = 0, count = 1 + draws.below(3); i < count; ++i) {
    // The command itself stays.
    const std::size_t at = arguments.size() > 1 ? 1 + draws.below(arguments.size() - 1) : 0;
    const std::string word =
        draws.chance(0.03) ? std::string(20000, '9') : std::string(draws.one_of(kWords));
    switch (draws.below(8)) {
      case 0:
        if (at > 0) arguments.erase(arguments.begin() + static_cast<long>(at));
        break;
      case 1:
        arguments.push_back(arguments[at]);
        break;
      case 2:
        if (at > 0) std::swap(arguments[at], arguments.back());
        break;
      case 3:
        if (at > 0) arguments[at] = word;
        break;
      case 4:
        if (at > 0 && arguments[at].rfind("--", 0) != 0) arguments[at] += word;
        break;
      default:
        if (options.empty()) break;
        arguments.push_back(draws.one_of(options));
        if (draws.chance(0.9)) arguments.push_back(word);
    }
  }
  return arguments;
}

}  // namespace camber::test
