#include "camber/cloud/detail/pcd_header.h"

#include <cmath>
#include <limits>
#include <optional>
#include <set>

#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber::detail {
namespace {

constexpr std::size_t kHeaderLine = 1 << 16;  // bytes

class PcdHeaderReader {
 public:
  PcdHeaderReader(FileReader& file, LineReader& lines,
                  const std::function<void(std::string_view)>& comment, ReadReport* report)
      : file_(file), lines_(lines), comment_(comment), report_(report) {}

  PcdHeader read();

 private:
  std::vector<std::string_view> words(std::string_view line) {
    std::vector<std::string_view> out;
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line)) {
      out.push_back(word);
    }
    return out;
  }

  std::uint64_t number(const std::vector<std::string_view>& values, const char* key) {
    std::uint64_t value = 0;
    if (values.size() != 1 || !parse_unsigned(values[0], value)) {
      lines_.fail(std::string("found ") + (values.empty() ? "nothing" : shown(values[0])) +
                  " after " + key + ", expected one whole number");
    }
    return value;
  }

  /// One value a field after a key of the header.
  void expect_one_each(const std::vector<std::string_view>& values, const char* key) {
    if (header_.fields.empty())
      lines_.fail(std::string("found ") + key + ", expected FIELDS before it");
    if (values.size() != header_.fields.size()) {
      lines_.fail("found " + std::to_string(values.size()) + " values after " + key +
                  ", expected one for each of " + std::to_string(header_.fields.size()) +
                  " fields");
    }
  }

  void check_keyword(const std::string& key, std::string_view word, std::string_view line);
  void read_fields(const std::vector<std::string_view>& values);
  void read_sizes(const std::vector<std::string_view>& values);
  void read_types(const std::vector<std::string_view>& values);
  void read_counts(const std::vector<std::string_view>& values);
  void read_viewpoint(const std::vector<std::string_view>& values);
  void read_data(std::string_view line, const std::vector<std::string_view>& values);
  void count_points();

  FileReader& file_;
  LineReader& lines_;
  const std::function<void(std::string_view)>& comment_;
  ReadReport* report_;
  PcdHeader header_;
  std::optional<std::uint64_t> width_, height_, points_;
  bool sizes_seen_ = false, types_seen_ = false;
  std::set<std::string> seen_;  // keywords
};

void PcdHeaderReader::check_keyword(const std::string& key, std::string_view word,
                                    std::string_view line) {
  if (key != "version" && key != "fields" && key != "columns" && key != "size" && key != "type" &&
      key != "count" && key != "width" && key != "height" && key != "viewpoint" &&
      key != "points" && key != "data") {
    if (seen_.empty()) {
      lines_.fail("found " + shown(line) +
                  ", expected a PCD header (VERSION, FIELDS, ...); a file of bare numbers can be "
                  "read as text");
    }
    lines_.fail("found " + shown(word) + ", expected a keyword of a PCD header");
  }
  if (!seen_.insert(key == "columns" ? "fields" : key).second) {
    lines_.fail("found a second " + shown(word) + " line, expected one");
  }
}

void PcdHeaderReader::read_fields(const std::vector<std::string_view>& values) {
  if (values.empty()) lines_.fail("found no names after FIELDS, expected x y z ...");
  if (values.size() > kMostPcdFields) {
    lines_.fail("found " + std::to_string(values.size()) + " fields, expected at most " +
                std::to_string(kMostPcdFields));
  }
  for (const std::string_view name : values) {
    PcdField field;
    field.name = std::string(name);
    header_.fields.push_back(std::move(field));
  }
}

void PcdHeaderReader::read_sizes(const std::vector<std::string_view>& values) {
  expect_one_each(values, "SIZE");
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::uint64_t size = 0;
    if (!parse_unsigned(values[i], size) || (size != 1 && size != 2 && size != 4 && size != 8)) {
      lines_.fail("found size " + shown(values[i]) + ", expected 1, 2, 4 or 8");
    }
    header_.fields[i].size = size;
  }
  sizes_seen_ = true;
}

void PcdHeaderReader::read_types(const std::vector<std::string_view>& values) {
  expect_one_each(values, "TYPE");
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::string_view type = values[i];
    if (type != "F" && type != "I" && type != "U" && type != "f" && type != "i" && type != "u") {
      lines_.fail("found type " + shown(type) + ", expected I, U or F");
    }
    header_.fields[i].type = static_cast<char>(type[0] & ~0x20);
  }
  types_seen_ = true;
}

void PcdHeaderReader::read_counts(const std::vector<std::string_view>& values) {
  expect_one_each(values, "COUNT");
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!parse_unsigned(values[i], header_.fields[i].count) || header_.fields[i].count > 1u << 24) {
      lines_.fail("found count " + shown(values[i]) + ", expected a number below 16777217");
    }
  }
}

/// Nothing here hangs on it: what is no view point is passed over.
void PcdHeaderReader::read_viewpoint(const std::vector<std::string_view>& values) {
  std::array<double, 7> out{};
  bool good = values.size() == out.size();
  for (std::size_t i = 0; i < out.size() && good; ++i) {
    const char* const end = values[i].data() + values[i].size();
    const ParsedNumber number = parse_number(values[i].data(), end);
    good = number.end == end && std::isfinite(number.value);
    out[i] = number.value;
  }
  if (good) {
    header_.viewpoint = out;
  } else {
    report_->notes.emplace_back(
        "the VIEWPOINT is not seven numbers (x y z and a quaternion w x y z) and is not kept");
  }
}

void PcdHeaderReader::read_data(std::string_view line,
                                const std::vector<std::string_view>& values) {
  if (values.size() != 1) lines_.fail("found " + shown(line) + ", expected DATA and one word");
  const std::string data = lower_case(values[0]);
  if (data == "ascii") {
    header_.body = PcdBody::kAscii;
  } else if (data == "binary") {
    header_.body = PcdBody::kBinary;
  } else if (data == "binary_compressed") {
    header_.body = PcdBody::kCompressed;
  } else {
    lines_.fail("found DATA " + shown(values[0]) + ", expected ascii, binary or binary_compressed");
  }
  report_->encoding = data;
}

/// WIDTH times HEIGHT, or POINTS; both must agree.
void PcdHeaderReader::count_points() {
  if (!points_ && !width_)
    lines_.fail("found no POINTS and no WIDTH line, expected the number of points");
  if (width_) {
    const std::uint64_t rows = height_.value_or(1);
    constexpr std::uint64_t kLargest = std::numeric_limits<std::uint32_t>::max();
    if (*width_ > kLargest || rows > kLargest) {
      lines_.fail("found WIDTH " + std::to_string(*width_) + " and HEIGHT " + std::to_string(rows) +
                  ", expected numbers below 4294967296");
    }
    const std::uint64_t product = *width_ * rows;  // below 2^64
    if (points_ && *points_ != product) {
      lines_.fail("found POINTS " + std::to_string(*points_) +
                  ", expected WIDTH x HEIGHT = " + std::to_string(product));
    }
    header_.points = product;
    if (rows > 1) {
      report_->width = static_cast<std::uint32_t>(*width_);
      report_->height = static_cast<std::uint32_t>(rows);
    }
  } else {
    header_.points = *points_;
  }
  report_->declared = header_.points;
}

PcdHeader PcdHeaderReader::read() {
  std::string_view line;
  while (true) {
    if (!lines_.next(line, kHeaderLine)) {
      file_.fail_at(file_.size(),
                    "found the end of the file, expected a DATA line of a PCD header");
    }
    if (file_.position() > (std::uint64_t{1} << 24)) {
      lines_.fail("found a header of more than 16 MB, expected a DATA line before");
    }
    std::string_view rest = line;
    const std::string_view word = next_word(rest);
    if (word.empty()) continue;
    if (word[0] == '#') {
      std::string_view comment = line.substr(line.find('#') + 1);
      comment_(comment);
      continue;
    }
    const std::string key = lower_case(word);
    const std::vector<std::string_view> values = words(rest);
    check_keyword(key, word, line);
    if (key == "fields" || key == "columns") {
      read_fields(values);
    } else if (key == "size") {
      read_sizes(values);
    } else if (key == "type") {
      read_types(values);
    } else if (key == "count") {
      read_counts(values);
    } else if (key == "width") {
      width_ = number(values, "WIDTH");
    } else if (key == "height") {
      height_ = number(values, "HEIGHT");
    } else if (key == "viewpoint") {
      read_viewpoint(values);
    } else if (key == "points") {
      points_ = number(values, "POINTS");
    } else if (key == "data") {
      read_data(line, values);
      break;
    }
  }
  if (header_.fields.empty()) lines_.fail("found DATA, expected a FIELDS line before it");
  if (header_.body != PcdBody::kAscii && (!sizes_seen_ || !types_seen_)) {
    lines_.fail("found no SIZE or no TYPE line, expected both before binary data");
  }
  count_points();
  return std::move(header_);
}

}  // namespace

PcdHeader read_pcd_header(FileReader& file, LineReader& lines,
                          const std::function<void(std::string_view)>& comment,
                          ReadReport* report) {
  return PcdHeaderReader(file, lines, comment, report).read();
}

}  // namespace camber::detail
