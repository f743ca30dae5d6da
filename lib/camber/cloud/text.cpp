// Points as text: one a line, values between blanks, commas, semicolons or tabs, with or without a
// line of names before them.

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kMostColumns = 4096;
constexpr std::size_t kLongestLine = 1 << 20;  // bytes

/// Splits a line at a separator, or at runs of blanks for ' '; words lose blanks and quotes.
std::vector<std::string_view> split(std::string_view line, char separator) {
  std::vector<std::string_view> words;
  if (separator == ' ') {
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line)) {
      words.push_back(word);
    }
  } else {
    while (true) {
      const std::size_t end = std::min(line.find(separator), line.size());
      words.push_back(line.substr(0, end));
      if (end == line.size()) break;
      line.remove_prefix(end + 1);
    }
  }
  for (std::string_view& word : words) {
    while (!word.empty() && is_blank(word.front())) word.remove_prefix(1);
    while (!word.empty() && is_blank(word.back())) word.remove_suffix(1);
    if (word.size() >= 2 && word.front() == '"' && word.back() == '"') {
      word = word.substr(1, word.size() - 2);
    }
  }
  return words;
}

bool is_number(std::string_view word) {
  const ParsedNumber number = parse_number(word.data(), word.data() + word.size());
  return number.end != nullptr && number.end == word.data() + word.size();
}

/// Columns x_m, y_m and z_m are x, y and z where there are none of these names.
void take_metres_for_axes(std::vector<std::string>* names) {
  for (const char axis : {'x', 'y', 'z'}) {
    const std::string plain(1, axis), with_unit = plain + "_m";
    if (std::find(names->begin(), names->end(), plain) != names->end()) continue;
    const auto found = std::find(names->begin(), names->end(), with_unit);
    if (found != names->end()) *found = plain;
  }
}

/// How many of x and y are among the names.
int count_axes(std::vector<std::string> names) {
  take_metres_for_axes(&names);
  std::vector<PointField> fields(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) fields[i].name = names[i];
  const FieldRoles roles = find_roles(fields);
  return (roles.position[0] >= 0 ? 1 : 0) + (roles.position[1] >= 0 ? 1 : 0);
}

char find_separator(std::string_view line) {
  for (const char separator : {';', ','}) {
    if (line.find(separator) != std::string_view::npos) return separator;
  }
  return ' ';
}

class TextSource : public FormatSource {
 public:
  TextSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kText;
    read_head();
    read_rows();
    rows_pending_ = true;
  }

  bool next(PointBatch& batch) override {
    if (!rows_pending_) read_rows();
    rows_pending_ = false;
    rows_.fill(batch);
    for (std::size_t c = 0; c < batch.fields.size(); ++c) {
      batch.fields[c].fractional = fractional_[c] != 0;
    }
    report_.points += batch.count;
    if (batch.count > 0) return true;
    if (promised_ && *promised_ != seen_ && !checked_) {
      checked_ = true;
      if (!options_.lenient) {
        lines_.fail("found " + std::to_string(seen_) + " points, expected the " +
                    std::to_string(*promised_) + " of the first line");
      }
      if (*promised_ > seen_) report_.drop("truncated", *promised_ - seen_);
    }
    return false;
  }

 private:
  void read_head();
  void read_rows();
  void name_columns(std::vector<std::string> names);
  bool next_line(std::string_view& line);

  char separator_ = ' ';
  std::string first_;  // a data line that was read to find out about the file
  bool first_pending_ = false;
  std::optional<std::uint64_t> promised_;
  std::uint64_t seen_ = 0;
  bool checked_ = false;
  std::vector<ColumnRule> rules_;
  std::vector<unsigned char> fractional_;
  RowBuffer rows_;
  bool rows_pending_ = false;
};

/// The next line that is not empty; comments are looked into and passed over.
bool TextSource::next_line(std::string_view& line) {
  if (first_pending_) {
    first_pending_ = false;
    line = first_;
    return true;
  }
  while (lines_.next(line, kLongestLine)) {
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    if (word.empty()) continue;
    if (word[0] == '#') {
      read_comment(line.substr(line.find('#') + 1));
      continue;
    }
    if (word.substr(0, 2) == "//") continue;
    return true;
  }
  return false;
}

void TextSource::read_head() {
  std::string_view line;
  std::string comment;  // the last one before the data may hold the names
  bool found = false;
  while (!found && lines_.next(line, kLongestLine)) {
    if (lines_.line() == 1 && line.substr(0, 3) == "\xef\xbb\xbf") line.remove_prefix(3);
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    if (word.empty()) continue;
    if (word[0] == '#' || word.substr(0, 2) == "//") {
      std::string_view text = line.substr(line.find(word[0]));
      while (!text.empty() && (text[0] == '#' || text[0] == '/')) text.remove_prefix(1);
      read_comment(text);
      std::string_view first_word = text;
      if (next_word(first_word) != "camber") comment = std::string(text);
      continue;
    }
    found = true;
  }
  if (!found) {
    if (options_.columns.empty()) {
      // An empty file is an empty cloud; the comment may still name its columns.
      std::vector<std::string> names;
      for (const std::string_view word : split(comment, find_separator(comment))) {
        names.emplace_back(word);
      }
      name_columns(count_axes(names) == 2 ? names : std::vector<std::string>{"x", "y", "z"});
    } else {
      name_columns(options_.columns);
    }
    report_.encoding = "text";
    return;
  }
  for (const char c : line.substr(0, 1024)) {
    if (c == '\0') lines_.fail("found binary data, expected lines of numbers");
  }
  separator_ = find_separator(line);
  std::vector<std::string_view> words = split(line, separator_);
  bool numbers = true;
  for (std::size_t c = 0; c < words.size(); ++c) {
    // A column that is skipped may hold words.
    const bool skipped = c < options_.columns.size() && options_.columns[c] == "_";
    numbers = numbers && (skipped || words[c].empty() || is_number(words[c]));
  }
  std::vector<std::string> names = options_.columns;
  if (!numbers) {
    // A line of names. Given columns go before it.
    if (words.size() > kMostColumns) {
      lines_.fail("found " + std::to_string(words.size()) + " columns, expected at most " +
                  std::to_string(kMostColumns));
    }
    if (names.empty()) names.assign(words.begin(), words.end());
    if (separator_ == ' ' && count_axes(names) < 2 && options_.columns.empty()) {
      lines_.fail("found " + shown(line) +
                  ", expected numbers or the names of columns with x and y");
    }
  } else if (words.size() == 1 && options_.columns.size() != 1) {
    // The number of points before the points, as .pts files have it.
    std::uint64_t count = 0;
    if (!parse_unsigned(words[0], count)) {
      lines_.fail(
          "found one value, expected at least x and y, between blanks, commas or semicolons");
    }
    promised_ = count;
    if (count > file_->remaining() && !options_.lenient) {
      lines_.fail("found the number of points " + std::to_string(count) +
                  ", expected no more than the file has room for");
    }
    if (lines_.next(line, kLongestLine)) {
      separator_ = find_separator(line);
      words = split(line, separator_);
      first_ = std::string(line);
      first_pending_ = !words.empty();
    }
  } else {
    first_ = std::string(line);
    first_pending_ = true;
  }
  if (names.empty()) {
    const std::vector<std::string_view> from_comment = split(comment, find_separator(comment));
    std::vector<std::string> candidates(from_comment.begin(), from_comment.end());
    if (candidates.size() == words.size() && count_axes(candidates) >= 2) names = candidates;
  }
  if (names.empty()) {
    if (words.size() < 2) {
      lines_.fail("found " + std::to_string(words.size()) +
                  " values, expected at least x and y, between blanks, commas or semicolons");
    }
    if (words.size() > kMostColumns) {
      lines_.fail("found " + std::to_string(words.size()) + " columns, expected at most " +
                  std::to_string(kMostColumns));
    }
    for (std::size_t c = 0; c < words.size(); ++c) {
      static const char* const kAxes[] = {"x", "y", "z"};
      names.push_back(c < 3 ? kAxes[c] : "column_" + std::to_string(c + 1));
    }
    report_.notes.emplace_back("there is no line of names; the first columns are taken as x y z");
  }
  report_.encoding = separator_ == ',' ? "commas" : separator_ == ';' ? "semicolons" : "blanks";
  name_columns(std::move(names));
}

void TextSource::name_columns(std::vector<std::string> names) {
  take_metres_for_axes(&names);
  std::set<std::string> seen;
  for (std::size_t c = 0; c < names.size(); ++c) {
    ColumnRule rule;
    if (names[c] != "_") {
      if (names[c].empty()) names[c] = "column_" + std::to_string(c + 1);
      if (!seen.insert(names[c]).second) {
        const std::string found =
            "found column " + shown(names[c]) + " twice, expected different names";
        if (lines_.line() == 0) throw InputError(file_->name(), found);
        if (!options_.lenient) lines_.fail(found);
        do {
          names[c] += "_" + std::to_string(c + 1);
        } while (!seen.insert(names[c]).second);
      }
      rule.column = static_cast<int>(header_.fields.size());
      PointField field;
      field.name = names[c];
      field.type = ScalarType::kFloat64;
      field.text = true;
      header_.fields.push_back(std::move(field));
    }
    rules_.push_back(rule);
  }
  check_fields("line " + std::to_string(std::max<std::uint64_t>(lines_.line(), 1)));
  rows_.start(std::vector<ScalarType>(header_.fields.size(), ScalarType::kFloat64));
  fractional_.assign(header_.fields.size(), 0);
}

void TextSource::read_rows() {
  rows_.clear();
  std::string_view line;
  while (!rows_.full() && next_line(line)) {
    ++seen_;
    const std::string wrong = parse_row(line, rules_, separator_, rows_.new_row(), &fractional_);
    if (wrong.empty()) {
      rows_.keep_row();
    } else if (options_.lenient) {
      report_.drop("bad line");
    } else {
      lines_.fail(wrong);
    }
  }
}

// --- writing -----------------------------------------------------------------------------------

class TextSink : public PointSink {
 public:
  TextSink(std::ostream& out, const PointStreamHeader& header, CloudEncoding encoding)
      : out_(out), header_(header), separator_(encoding == CloudEncoding::kCommas ? ',' : ' ') {
    if (encoding != CloudEncoding::kBinary && encoding != CloudEncoding::kAscii &&
        encoding != CloudEncoding::kCommas) {
      throw std::invalid_argument("text has no big-endian or compressed encoding");
    }
    packed_ = find_roles(header.fields).packed_color;
    std::string head;
    for (const std::string& comment : camber_comments(header)) head += "# " + comment + "\n";
    if (separator_ == ' ') head += "# ";
    for (std::size_t f = 0; f < header.fields.size(); ++f) {
      if (f > 0) head += separator_;
      if (static_cast<int>(f) == packed_) {
        head += std::string("red") + separator_ + "green" + separator_ + "blue";
        continue;
      }
      std::string name = header.fields[f].name;
      for (char& c : name) {
        if (is_blank(c) || c == ',' || c == ';' || c == '\n' || c == '"') c = '_';
      }
      head += name;
    }
    head += '\n';
    out_.write(head.data(), static_cast<std::streamsize>(head.size()));
  }

  void write(const PointBatch& batch) override {
    text_.clear();
    for (std::size_t i = 0; i < batch.count; ++i) {
      for (std::size_t f = 0; f < batch.fields.size(); ++f) {
        if (f > 0) text_ += separator_;
        if (static_cast<int>(f) == packed_) {
          const std::uint32_t rgb = batch.fields[f].get<std::uint32_t>(i);
          for (const unsigned shift : {16u, 8u, 0u}) {
            append_number(text_, static_cast<std::uint64_t>(rgb >> shift & 255u));
            if (shift > 0) text_ += separator_;
          }
          continue;
        }
        const std::size_t start = text_.size();
        append_value(text_, batch.fields[f], header_.fields[f].type, i);
        // So that an attribute that is not an integer one does not look like one.
        if (is_float(header_.fields[f].type) && !header_.fields[f].text &&
            text_.find_first_not_of("-0123456789", start) == std::string::npos) {
          text_ += ".0";
        }
      }
      text_ += '\n';
    }
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
  }

  void finish() override {}

 private:
  std::ostream& out_;
  PointStreamHeader header_;
  char separator_;
  int packed_ = -1;
  std::string text_;
};

}  // namespace

std::unique_ptr<PointSource> open_text(std::unique_ptr<FileReader> file,
                                       const ReadOptions& options) {
  return std::make_unique<TextSource>(std::move(file), options);
}

std::unique_ptr<PointSink> make_text_sink(std::ostream& out, const PointStreamHeader& header,
                                          CloudEncoding encoding) {
  return std::make_unique<TextSink>(out, header, encoding);
}

}  // namespace camber
