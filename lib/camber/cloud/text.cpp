// Points as text: one a line, values between blanks, commas, semicolons or tabs, with or without a
// line of names before them.

#include <algorithm>
#include <array>
#include <set>

#include "camber/cloud/detail/text_columns.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

using detail::AxisColumns;
using detail::find_axes;
using detail::split_line;
using detail::split_names;

constexpr std::size_t kMostColumns = 4096;
constexpr std::size_t kLongestLine = 1 << 20;  // bytes
constexpr std::size_t kMostHeaderLines = 64;   // that are kept
constexpr std::size_t kMostHeaderBytes = 1 << 16;

class TextSource : public FormatSource {
 public:
  TextSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kText;
    report_.text.emplace();
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
  bool read_comments(std::string_view& line);
  void read_empty();
  std::vector<std::string> read_first_line(std::string_view line);
  void read_count(std::string_view word);
  void look_at_first_row();
  std::vector<std::string> names_from_comments(std::size_t columns) const;
  std::vector<std::string> names_by_number(std::size_t columns);
  void check_names(std::vector<std::string>& names);
  void build_columns(const std::vector<std::string>& names);
  void take_units(const AxisColumns& axes);
  void keep_header_line(std::string_view line);
  void read_rows();
  bool next_line(std::string_view& line);

  detail::NumberStyle style_;
  std::string first_;  // a data line that was read to find out about the file
  bool first_pending_ = false;
  std::optional<std::uint64_t> promised_;
  std::uint64_t seen_ = 0;
  bool checked_ = false;
  bool named_ = false;                 // by a line of names or a comment
  std::vector<std::string> comments_;  // the last ones before the data may hold the names
  int epsg_ = 0;                       // in a comment
  std::size_t header_bytes_ = 0;
  std::vector<ColumnRule> rules_;
  std::vector<unsigned char> fractional_;
  std::string with_points_;
  RowBuffer rows_;
  bool rows_pending_ = false;
};

bool is_comment(std::string_view line) {
  const std::string_view word = next_word(line);
  return !word.empty() && (word[0] == '#' || word.substr(0, 2) == "//");
}

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

void TextSource::keep_header_line(std::string_view line) {
  TextLayout& layout = *report_.text;
  ++layout.header_lines;
  header_bytes_ += line.size();
  if (layout.header.size() < kMostHeaderLines && header_bytes_ < kMostHeaderBytes) {
    layout.header.push_back(detail::to_utf8(line));
  }
}

/// Passes over comments and empty lines; false at the end of the file.
bool TextSource::read_comments(std::string_view& line) {
  constexpr std::size_t kMostComments = 16;
  int epsg = 0;
  while (lines_.next(line, kLongestLine)) {
    if (lines_.line() == 1) {
      report_.text->line_ends = lines_.ends();
      if (line.substr(0, 3) == "\xef\xbb\xbf") line.remove_prefix(3);
    }
    std::string_view rest = line;
    if (next_word(rest).empty()) continue;
    if (!is_comment(line)) {
      epsg_ = epsg;
      return true;
    }
    keep_header_line(line);
    std::string_view text = line;
    while (!text.empty() && (is_blank(text[0]) || text[0] == '#' || text[0] == '/')) {
      text.remove_prefix(1);
    }
    read_comment(text);
    if (epsg == 0) epsg = detail::find_epsg_code(text.substr(0, 4096));
    std::string_view first_word = text;
    if (next_word(first_word) == "camber" || text.size() > kMostHeaderBytes) continue;
    if (comments_.size() == kMostComments) comments_.erase(comments_.begin());
    comments_.emplace_back(text);
  }
  return false;
}

/// An empty file is an empty cloud; a comment may still name its columns.
void TextSource::read_empty() {
  report_.encoding = "text";
  std::vector<std::string> names = options_.columns;
  if (names.empty() && !comments_.empty()) {
    const std::string& comment = comments_.back();
    names = split_names(comment, detail::find_number_style(comment).separator);
  }
  if (options_.columns.empty() && !find_axes(names).found()) names = {"x", "y", "z"};
  check_names(names);
  build_columns(names);
}

void TextSource::read_count(std::string_view word) {
  std::uint64_t count = 0;
  if (!parse_unsigned(word, count)) {
    lines_.fail("found one value, expected at least x and y, between blanks, commas or semicolons");
  }
  promised_ = count;
  if (count > file_->remaining() && !options_.lenient) {
    lines_.fail("found the number of points " + std::to_string(count) +
                ", expected no more than the file has room for");
  }
  report_.text->count_line = count;
}

/// The names in the first line that is no comment, if it is one of names; the first row of numbers
/// is in first_ then, if there is one.
std::vector<std::string> TextSource::read_first_line(std::string_view line) {
  style_ = detail::find_number_style(line);
  const std::vector<std::string_view> words = split_line(line, style_.separator);
  bool numbers = true;
  for (std::size_t c = 0; c < words.size(); ++c) {
    // A column that is skipped may hold words.
    const bool skipped = c < options_.columns.size() && options_.columns[c] == "_";
    numbers = numbers &&
              (skipped || words[c].empty() || detail::is_number(words[c], style_.decimal_comma));
  }
  if (numbers && !(words.size() == 1 && options_.columns.size() != 1)) {
    first_ = std::string(line);
    first_pending_ = true;
    return {};
  }
  keep_header_line(line);
  std::vector<std::string> names;
  if (numbers) {
    // The number of points before the points, as .pts files have it.
    read_count(words[0]);
  } else {
    if (words.size() > kMostColumns) {
      lines_.fail("found " + std::to_string(words.size()) + " columns, expected at most " +
                  std::to_string(kMostColumns));
    }
    names = split_names(line, style_.separator);
    if (style_.separator == ' ' && !find_axes(names).found() && options_.columns.empty()) {
      lines_.fail("found " + shown(line) +
                  ", expected numbers or the names of columns with x and y");
    }
  }
  return names;
}

/// The first row decides on separator and decimal sign.
void TextSource::look_at_first_row() {
  std::string_view line;
  if (!first_pending_) {
    if (!next_line(line)) return;
    first_ = std::string(line);
    first_pending_ = true;
  }
  const detail::NumberStyle style = detail::find_number_style(first_);
  // A row of blanks below names with commas is a damaged one, not another style.
  const bool row_decides = !named_ || style.decimal_comma || style.separator == style_.separator;
  if (row_decides) style_ = style;
}

/// The last comment that names as many columns as there are, x and y among them.
std::vector<std::string> TextSource::names_from_comments(std::size_t columns) const {
  for (auto comment = comments_.rbegin(); comment != comments_.rend(); ++comment) {
    for (const char separator : {';', ',', ' '}) {
      if (separator != ' ' && comment->find(separator) == std::string::npos) continue;
      std::vector<std::string> names = split_names(*comment, separator);
      if (names.size() == columns && find_axes(names).found()) return names;
    }
  }
  return {};
}

std::vector<std::string> TextSource::names_by_number(std::size_t columns) {
  if (columns < 2) {
    lines_.fail("found " + std::to_string(columns) +
                " values, expected at least x and y, between blanks, commas or semicolons");
  }
  if (columns > kMostColumns) {
    lines_.fail("found " + std::to_string(columns) + " columns, expected at most " +
                std::to_string(kMostColumns));
  }
  std::vector<std::string> names;
  for (std::size_t c = 0; c < columns; ++c) {
    static const char* const kAxes[] = {"x", "y", "z"};
    names.push_back(c < 3 ? kAxes[c] : "column_" + std::to_string(c + 1));
  }
  report_.notes.emplace_back("there is no line of names; the first columns are taken as x y z");
  return names;
}

void TextSource::read_head() {
  std::string_view line;
  if (!read_comments(line)) return read_empty();
  if (line.substr(0, 1024).find('\0') != std::string_view::npos) {
    lines_.fail("found binary data, expected lines of numbers");
  }
  std::vector<std::string> names = read_first_line(line);
  named_ = !names.empty();
  if (!options_.columns.empty()) names = options_.columns;
  if (named_) {
    // The names are judged before the next line is read, so that a complaint names their line.
    check_names(names);
    look_at_first_row();
  } else {
    look_at_first_row();
    const std::size_t columns = split_line(first_, style_.separator).size();
    if (names.empty()) names = names_from_comments(columns);
    if (names.empty()) names = names_by_number(columns);
    check_names(names);
  }
  build_columns(names);
  TextLayout& layout = *report_.text;
  const char separator = style_.separator;
  report_.encoding = separator == ',' ? "commas" : separator == ';' ? "semicolons" : "blanks";
  if (style_.decimal_comma) report_.encoding += ", decimal commas";
  layout.separator = separator == ',' ? "comma" : separator == ';' ? "semicolon" : "blanks or tabs";
  layout.decimal_sign = style_.decimal_comma ? ',' : '.';
}

/// Gives the axes their names and every column one of its own.
void TextSource::check_names(std::vector<std::string>& names) {
  const AxisColumns axes = find_axes(names);
  const std::uint64_t line = std::max<std::uint64_t>(lines_.line(), 1);
  report_.text->columns = names.size();
  report_.text->position = axes.column;
  std::set<std::string> seen;
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (names[c] == "_") continue;
    if (names[c].empty()) names[c] = "column_" + std::to_string(c + 1);
    if (seen.insert(names[c]).second) continue;
    const std::string found =
        "found column " + shown(names[c]) + " twice, expected different names";
    if (lines_.line() == 0) throw InputError(file_->name(), found);
    if (!options_.lenient) lines_.fail(found);
    do {
      names[c] += "_" + std::to_string(c + 1);
    } while (!seen.insert(names[c]).second);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (axes.column[axis] < 0) continue;
    std::string& name = names[static_cast<std::size_t>(axes.column[axis])];
    const std::string plain(1, "xyz"[axis]);
    if (lower_case(name) == plain) continue;
    for (std::string& other : names) {
      if (lower_case(other) == plain) other += "_";  // no axis, since it has no partner
    }
    name = plain;
  }
  if (!axes.found()) {
    throw InputError(file_->name(), "line " + std::to_string(line),
                     std::string("found no field '") + (seen.count("x") > 0 ? 'y' : 'x') +
                         "', expected x, y and z, or easting, northing and elevation");
  }
  take_units(axes);
}

void TextSource::take_units(const AxisColumns& axes) {
  if (header_.crs && !axes.horizontal.known()) return;  // by a comment of Camber's
  CoordinateSystem crs;  // nothing known, unless names or comments state it
  crs.epsg = epsg_;
  if (axes.geographic) crs.kind = CoordinateSystem::Kind::kGeographic;
  crs.horizontal = axes.horizontal;
  crs.vertical = axes.vertical;
  crs.vertical_stated = axes.vertical.known();
  if (!crs.vertical_stated) {
    crs.vertical = axes.geographic ? unit_from_epsg(9001) : axes.horizontal;
  }
  take_crs(crs);
}

/// Columns in which the first row has a word, but for the axes, are passed over.
void TextSource::build_columns(const std::vector<std::string>& names) {
  const std::vector<std::string_view> first =
      first_pending_ ? split_line(first_, style_.separator) : std::vector<std::string_view>();
  const std::array<int, 3>& axes = report_.text->position;
  const bool comparable = first.size() == names.size() && named_;
  for (std::size_t c = 0; c < names.size(); ++c) {
    ColumnRule rule;
    const bool axis = std::find(axes.begin(), axes.end(), static_cast<int>(c)) != axes.end();
    const bool words = comparable && !axis && !first[c].empty() &&
                       !detail::is_number(first[c], style_.decimal_comma);
    if (words) {
      report_.notes.push_back("column " + shown(names[c]) + " holds words and is not read");
    } else if (names[c] != "_") {
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
    if (style_.decimal_comma) {
      with_points_.assign(line);
      std::replace(with_points_.begin(), with_points_.end(), ',', '.');
      line = with_points_;
    }
    const std::string wrong =
        parse_row(line, rules_, style_.separator, rows_.new_row(), &fractional_);
    if (wrong.empty()) {
      rows_.keep_row();
    } else if (options_.lenient) {
      report_.drop("bad line");
    } else {
      lines_.fail(wrong);
    }
  }
}

}  // namespace

std::unique_ptr<PointSource> open_text(std::unique_ptr<FileReader> file,
                                       const ReadOptions& options) {
  return std::make_unique<TextSource>(std::move(file), options);
}

}  // namespace camber
