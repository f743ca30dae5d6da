// PTX, the text of laser scanners (Leica): scans one behind the other, each with the numbers of its
// columns and rows, the scanner's place and axes, a 4 x 4 matrix, and a point a line.

#include <cmath>

#include "camber/cloud/detail/text_columns.h"
#include "camber/cloud/formats.h"
#include "camber/cloud/number_text.h"

namespace camber {
namespace {

constexpr std::size_t kLongestLine = 4096;  // bytes
constexpr std::size_t kMostScans = 64;      // that are listed

class PtxSource : public FormatSource {
 public:
  PtxSource(std::unique_ptr<FileReader> file, const ReadOptions& options)
      : FormatSource(std::move(file), options) {
    report_.format = CloudFormat::kText;
    take_crs({});
    report_.encoding = "ptx";
    TextLayout& layout = report_.text.emplace();
    layout.separator = "blanks or tabs";
    layout.header_lines = 10;
    layout.position = {0, 1, 2};
    more_ = read_scan_header();
    while (more_ && left_ == 0) more_ = read_scan_header();
    if (rules_.empty()) rules_.resize(4);
    std::vector<ScalarType> types;
    static const char* const kNames[] = {"x", "y", "z", "intensity", "red", "green", "blue"};
    const std::size_t columns = rules_.size();
    for (std::size_t c = 0; c < columns; ++c) {
      PointField field;
      field.name = kNames[c];
      field.type = c < 4 ? ScalarType::kFloat64 : ScalarType::kUint8;
      types.push_back(field.type);
      header_.fields.push_back(std::move(field));
    }
    layout.columns = columns;
    rows_.start(std::move(types));
  }

  bool next(PointBatch& batch) override {
    rows_.clear();
    while (more_ && !rows_.full()) {
      if (left_ == 0) {
        more_ = read_scan_header();
      } else {
        read_row();
      }
    }
    rows_.fill(batch);
    report_.points += batch.count;
    if (batch.count > 0) return true;
    if (!counted_ && missing_ > 0) {
      report_.notes.push_back(std::to_string(missing_) +
                              " places of the scan without a return are left out");
    }
    counted_ = true;
    return false;
  }

 private:
  bool read_scan_header();
  void read_row();
  bool next_line(std::string_view& line);
  std::uint64_t read_size(const char* what);
  void read_numbers(std::size_t count, double* out);

  std::vector<ColumnRule> rules_;
  RowBuffer rows_;
  PtxScan scan_;
  std::uint64_t left_ = 0;  // points of the scan
  std::string first_;       // its first row, read to count its values
  bool first_pending_ = false, more_ = false, counted_ = false;
  std::uint64_t missing_ = 0;
};

bool PtxSource::next_line(std::string_view& line) {
  if (first_pending_) {
    first_pending_ = false;
    line = first_;
    return true;
  }
  while (lines_.next(line, kLongestLine)) {
    std::string_view rest = line;
    if (!next_word(rest).empty()) return true;
  }
  return false;
}

std::uint64_t PtxSource::read_size(const char* what) {
  std::string_view line;
  std::uint64_t value = 0;
  if (!next_line(line)) lines_.fail(std::string("found the end of the file, expected ") + what);
  std::string_view rest = line;
  const std::string_view word = next_word(rest);
  if (!parse_unsigned(word, value) || !next_word(rest).empty()) {
    lines_.fail("found " + shown(line) + ", expected " + what);
  }
  return value;
}

void PtxSource::read_numbers(std::size_t count, double* out) {
  std::string_view line;
  if (!next_line(line)) lines_.fail("found the end of the file, expected the scanner's pose");
  const std::vector<ColumnRule> rules = [&] {
    std::vector<ColumnRule> all(count);
    for (std::size_t i = 0; i < count; ++i) all[i].column = static_cast<int>(i);
    return all;
  }();
  const std::string wrong = parse_row(line, rules, ' ', out);
  if (!wrong.empty()) lines_.fail(wrong + " of the scanner's pose");
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isfinite(out[i])) lines_.fail("found a number that is not finite in the pose");
  }
}

/// False at the end of the file.
bool PtxSource::read_scan_header() {
  std::string_view line;
  if (!next_line(line)) return false;
  if (report_.scans.empty()) report_.text->line_ends = lines_.ends();
  first_ = std::string(line);
  first_pending_ = true;
  scan_.columns = read_size("the number of a scan's columns");
  scan_.rows = read_size("the number of a scan's rows");
  double place[4];
  for (int k = 0; k < 4; ++k) read_numbers(3, place);
  for (std::size_t k = 0; k < 4; ++k) read_numbers(4, scan_.pose.data() + 4 * k);
  // Two bytes a point at least.
  const std::uint64_t room = file_->remaining() / 2 + 1;
  if (scan_.columns > 0 && scan_.rows > room / scan_.columns && !options_.lenient) {
    lines_.fail("found a scan of " + std::to_string(scan_.columns) + " by " +
                std::to_string(scan_.rows) + " points, more than the file has room for");
  }
  const bool fits = scan_.columns == 0 || scan_.rows <= UINT64_MAX / scan_.columns;
  left_ = fits ? scan_.columns * scan_.rows : UINT64_MAX;
  report_.declared += left_;
  if (report_.scans.size() < kMostScans) report_.scans.push_back(scan_);
  if (report_.scans.size() == 1) {
    report_.width = static_cast<std::uint32_t>(std::min<std::uint64_t>(scan_.columns, UINT32_MAX));
    report_.height = static_cast<std::uint32_t>(std::min<std::uint64_t>(scan_.rows, UINT32_MAX));
  } else {
    report_.width = report_.height = 0;
  }
  if (rules_.empty() && left_ > 0 && next_line(line)) {
    first_ = std::string(line);
    first_pending_ = true;
    const std::size_t values = detail::split_line(first_, ' ').size();
    if (values != 3 && values != 4 && values != 7) {
      lines_.fail("found " + std::to_string(values) +
                  " values, expected x y z, intensity and perhaps red green blue");
    }
    rules_.resize(values);
    for (std::size_t c = 0; c < values; ++c) {
      rules_[c].column = static_cast<int>(c);
      rules_[c].type = c < 4 ? ScalarType::kFloat64 : ScalarType::kUint8;
    }
  }
  return true;
}

void PtxSource::read_row() {
  std::string_view line;
  if (!next_line(line)) {
    if (!options_.lenient) {
      lines_.fail("found the end of the file, expected " + std::to_string(left_) +
                  " more points of the scan");
    }
    report_.drop("truncated", left_);
    more_ = false;
    return;
  }
  --left_;
  double* const row = rows_.new_row();
  const std::string wrong = parse_row(line, rules_, ' ', row);
  if (!wrong.empty()) {
    if (!options_.lenient) lines_.fail(wrong);
    report_.drop("bad line");
    return;
  }
  if (row[0] == 0.0 && row[1] == 0.0 && row[2] == 0.0) {
    ++missing_;  // the scanner saw nothing there
    return;
  }
  const std::array<double, 16>& m = scan_.pose;
  const double x = row[0], y = row[1], z = row[2];
  for (std::size_t c = 0; c < 3; ++c) row[c] = x * m[c] + y * m[4 + c] + z * m[8 + c] + m[12 + c];
  rows_.keep_row();
}

}  // namespace

std::unique_ptr<PointSource> open_ptx(std::unique_ptr<FileReader> file,
                                      const ReadOptions& options) {
  return std::make_unique<PtxSource>(std::move(file), options);
}

}  // namespace camber
