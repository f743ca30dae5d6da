#include "camber/cloud/detail/text_columns.h"

#include <algorithm>
#include <cctype>
#include <initializer_list>

#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber::detail {
namespace {

void strip(std::string_view& word) {
  while (!word.empty() && is_blank(word.front())) word.remove_prefix(1);
  while (!word.empty() && is_blank(word.back())) word.remove_suffix(1);
  if (word.size() >= 2 && word.front() == '"' && word.back() == '"') {
    word = word.substr(1, word.size() - 2);
  }
}

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const unsigned char c = static_cast<unsigned char>(text[i]);
    const std::size_t length = c < 0x80                ? 1
                               : c >= 0xc2 && c < 0xe0 ? 2
                               : c >= 0xe0 && c < 0xf0 ? 3
                               : c >= 0xf0 && c < 0xf5 ? 4
                                                       : 0;
    if (length == 0 || i + length > text.size()) return false;
    for (std::size_t k = 1; k < length; ++k) {
      if ((static_cast<unsigned char>(text[i + k]) & 0xc0) != 0x80) return false;
    }
    i += length;
  }
  return true;
}

/// A column's name in pieces: "UTM-East [ft]" is the words utm and east, and a unit.
struct ColumnName {
  std::vector<std::string> words;  // lower case
  std::string unit;

  bool has(std::initializer_list<const char*> any) const {
    for (const char* word : any) {
      if (std::find(words.begin(), words.end(), word) != words.end()) return true;
    }
    return false;
  }
  bool is(const char* word) const { return words.size() == 1 && words[0] == word; }
};

ColumnName take_apart(const std::string& name) {
  ColumnName out;
  std::string base = lower_case(name);
  const std::size_t open = base.find_first_of("[(");
  if (open != std::string::npos && open > 0) {
    const std::size_t close = base.find_first_of("])", open);
    if (close != std::string::npos) out.unit = base.substr(open + 1, close - open - 1);
    base.resize(open);
  }
  std::string word;
  for (const char c : base + " ") {
    if (std::isalnum(static_cast<unsigned char>(c))) {
      word += c;
    } else if (!word.empty()) {
      out.words.push_back(word);
      word.clear();
    }
  }
  // "x_m", "northing_ft"; not "m" alone
  if (out.unit.empty() && out.words.size() > 1 && unit_from_name(out.words.back()).known()) {
    out.unit = out.words.back();
    out.words.pop_back();
  }
  return out;
}

}  // namespace

std::string to_utf8(std::string_view text) {
  if (is_utf8(text)) return std::string(text);
  std::string out;
  for (const char c : text) {
    const unsigned char byte = static_cast<unsigned char>(c);
    if (byte < 0x80) {
      out += c;
    } else {
      out += static_cast<char>(0xc0 | byte >> 6);
      out += static_cast<char>(0x80 | (byte & 0x3f));
    }
  }
  return out;
}

std::vector<std::string_view> split_line(std::string_view line, char separator) {
  std::vector<std::string_view> words;
  if (separator == ' ') {
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line)) {
      words.push_back(word);
    }
  } else {
    while (true) {
      std::size_t end = 0;
      for (bool quoted = false; end < line.size(); ++end) {
        if (line[end] == '"') quoted = !quoted;
        if (line[end] == separator && !quoted) break;
      }
      words.push_back(line.substr(0, end));
      if (end == line.size()) break;
      line.remove_prefix(end + 1);
    }
  }
  for (std::string_view& word : words) strip(word);
  return words;
}

std::vector<std::string> split_names(std::string_view line, char separator) {
  if (separator == ' ') {
    std::string_view trimmed = line;
    while (!trimmed.empty() && is_blank(trimmed.front())) trimmed.remove_prefix(1);
    while (!trimmed.empty() && is_blank(trimmed.back())) trimmed.remove_suffix(1);
    if (trimmed.find('\t') != std::string_view::npos) {
      separator = '\t';
      line = trimmed;
    }
  }
  std::vector<std::string> names;
  for (const std::string_view word : split_line(line, separator)) {
    const bool unit = separator == ' ' && !names.empty() && word.size() > 1 &&
                      (word.front() == '[' || word.front() == '(');
    if (unit) {
      names.back() += " " + to_utf8(word);
    } else {
      names.push_back(to_utf8(word));
    }
  }
  return names;
}

bool is_number(std::string_view word, bool decimal_comma) {
  std::string copy;
  if (decimal_comma) {
    copy = std::string(word);
    std::replace(copy.begin(), copy.end(), ',', '.');
    word = copy;
  }
  const ParsedNumber number = parse_number(word.data(), word.data() + word.size());
  return number.end != nullptr && number.end == word.data() + word.size();
}

NumberStyle find_number_style(std::string_view line) {
  const auto within_number = [](std::string_view word) {
    const std::size_t comma = word.find(',');
    return comma != std::string_view::npos && comma > 0 && comma + 1 < word.size() &&
           std::isdigit(static_cast<unsigned char>(word[comma + 1])) && is_number(word, true);
  };
  NumberStyle style;
  const bool commas = line.find(',') != std::string_view::npos;
  if (line.find(';') != std::string_view::npos) {
    style.separator = ';';
    if (!commas) return style;
    for (const std::string_view word : split_line(line, ';')) {
      style.decimal_comma = style.decimal_comma || within_number(word);
    }
    return style;
  }
  if (!commas) return style;
  const std::vector<std::string_view> words = split_line(line, ' ');
  bool all = words.size() >= 3, any = false;
  for (const std::string_view word : words) {
    const bool decimal = within_number(word);
    any = any || decimal;
    all = all && (decimal || is_number(word, false));
  }
  style.decimal_comma = all && any;
  style.separator = style.decimal_comma ? ' ' : ',';
  return style;
}

AxisColumns find_axes(const std::vector<std::string>& names) {
  std::vector<ColumnName> columns;
  for (const std::string& name : names) columns.push_back(take_apart(name));
  const auto first = [&](const auto& fits) {
    const auto found = std::find_if(columns.begin(), columns.end(), fits);
    return found == columns.end() ? -1 : static_cast<int>(found - columns.begin());
  };
  const auto named = [&](const char* name) {
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (names[c] == name) return static_cast<int>(c);
    }
    return first([&](const ColumnName& c) { return c.is(name); });
  };
  AxisColumns axes;
  axes.column = {named("x"), named("y"), named("z")};
  if (!axes.found()) {
    axes.column[0] = first([](const ColumnName& c) { return c.has({"easting", "east"}); });
    axes.column[1] = first([](const ColumnName& c) { return c.has({"northing", "north"}); });
    if (!axes.found()) {
      axes.column[0] = named("e");
      axes.column[1] = named("n");
    }
  }
  if (!axes.found()) {
    axes.column[0] = first([](const ColumnName& c) {
      return c.has({"longitude", "lon", "long", "lng"});
    });
    axes.column[1] = first([](const ColumnName& c) { return c.has({"latitude", "lat"}); });
    axes.geographic = axes.found();
  }
  if (!axes.found()) return {};
  if (axes.column[2] < 0) {
    axes.column[2] = first([](const ColumnName& c) {
      return c.has({"elevation", "elev", "altitude", "alt"}) || c.is("height") || c.is("h");
    });
  }
  axes.horizontal = unit_from_name(columns[static_cast<std::size_t>(axes.column[0])].unit);
  if (axes.geographic && !axes.horizontal.known()) axes.horizontal = unit_from_epsg(9102);
  if (axes.column[2] >= 0) {
    axes.vertical = unit_from_name(columns[static_cast<std::size_t>(axes.column[2])].unit);
  }
  return axes;
}

int find_epsg_code(std::string_view text) {
  const std::string lower = lower_case(text);
  const std::size_t at = lower.find("epsg:");
  if (at == std::string::npos) return 0;
  std::size_t digits = at + 5;
  while (digits < lower.size() && is_blank(lower[digits])) ++digits;
  int code = 0;
  for (; digits < lower.size() && std::isdigit(static_cast<unsigned char>(lower[digits]));
       ++digits) {
    code = 10 * code + (lower[digits] - '0');
    if (code > 999999) return 0;
  }
  return code;
}

}  // namespace camber::detail
