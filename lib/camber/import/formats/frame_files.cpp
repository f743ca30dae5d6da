#include "camber/import/formats/frame_files.h"

#include <fmt/format.h>
#include <glob.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <regex>
#include <set>

#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/import_common.h"
#include "camber/import/text_rows.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

bool is_image_name(const fs::path& file) {
  const std::string extension = lower_case(file.extension().string());
  const bool hidden = file.filename().string().rfind('.', 0) == 0;
  return !hidden && (extension == ".png" || extension == ".jpg" || extension == ".jpeg");
}

std::vector<fs::path> images_in(const fs::path& folder) {
  std::vector<fs::path> out;
  for (const fs::path& file : files_in(folder)) {
    if (is_image_name(file)) out.push_back(file);
  }
  return out;
}

std::vector<fs::path> images_of_pattern(const std::string& pattern) {
  ::glob_t found{};
  std::vector<fs::path> out;
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0) {
    for (std::size_t i = 0; i < found.gl_pathc; ++i) {
      const fs::path file = found.gl_pathv[i];
      if (is_image_name(file) && !is_special_file(file)) out.push_back(file);
    }
  }
  ::globfree(&found);
  return out;
}

/// Days since 1970 of a date of the Gregorian calendar (Hinnant, "chrono-compatible low-level date
/// algorithms").
long days_from_civil(long y, long m, long d) {
  y -= m <= 2;
  const long era = (y >= 0 ? y : y - 399) / 400;
  const long year_of_era = y - era * 400;
  const long day_of_year = (153 * (m + (m > 2 ? -3 : 9)) + 2) / 5 + d - 1;
  return era * 146097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year -
         719468;
}

std::optional<double> seconds_of(const std::smatch& m) {
  const auto number = [&](std::size_t i) { return m[i].matched ? std::stol(m[i].str()) : 0L; };
  const long year = number(1), month = number(2), day = number(3);
  const long hour = number(4), minute = number(5), second = number(6);
  if (year < 1970 || month < 1 || month > 12 || day < 1 || day > 31 || hour > 24 || minute > 59 ||
      second > 60) {
    return std::nullopt;
  }
  double out = static_cast<double>(days_from_civil(year, month, day) * 86400 + hour * 3600 +
                                   minute * 60 + second);
  if (m[7].matched) out += std::stod("0." + m[7].str());
  return out;
}

}  // namespace

bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto run = [](const std::string& text, std::size_t* at) {
        std::size_t from = *at;
        while (*at < text.size() && is_digit(text[*at])) ++*at;
        while (from + 1 < *at && text[from] == '0') ++from;
        return text.substr(from, *at - from);
      };
      const std::string x = run(a, &i), y = run(b, &j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
      continue;
    }
    if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
    ++i;
    ++j;
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;  // "01" and "1"
}

std::vector<fs::path> list_images(const std::vector<std::string>& places) {
  std::vector<fs::path> out;
  for (const std::string& place : places) {
    std::error_code error;
    std::vector<fs::path> here;
    if (fs::is_directory(place, error)) {
      here = images_in(place);
    } else if (is_special_file(place)) {
      throw InputError(place, "is a pipe or a device, expected an image or a folder of images");
    } else if (fs::exists(place, error)) {
      here = {place};
    } else if (place.find_first_of("*?[") != std::string::npos) {
      here = images_of_pattern(place);
    } else {
      throw InputError(place, "no such file or folder, expected images");
    }
    if (here.empty()) throw InputError(place, "found no PNG or JPEG image, expected at least one");
    out.insert(out.end(), here.begin(), here.end());
  }
  std::sort(out.begin(), out.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.string(), b.string());
  });
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

std::optional<double> parse_date_time(const std::string& text) {
  static const std::regex form(
      R"re(^(\d{4})[-/.:]?(\d{2})[-/.:]?(\d{2})[T _]?(\d{2})[:.-]?(\d{2})[:.-]?(\d{2})(?:[.,](\d{1,9})\d*)?(Z|[+-]\d{2}:?\d{2})?$)re");
  std::smatch m;
  if (text.size() > 64 || !std::regex_match(text, m, form)) return std::nullopt;
  std::optional<double> out = seconds_of(m);
  if (out && m[8].matched && m[8].str() != "Z") {
    const std::string zone = m[8].str();
    const double hours = std::stod(zone.substr(1, 2)),
                 minutes = std::stod(zone.substr(zone.size() - 2));
    *out -= (zone[0] == '-' ? -1.0 : 1.0) * (hours * 3600.0 + minutes * 60.0);
  }
  return out;
}

std::optional<double> time_from_name(const std::string& name) {
  std::string stem = fs::path(name).filename().string();
  for (const char* extension : {".png", ".jpg", ".jpeg"}) {
    const std::size_t length = std::string(extension).size();
    if (stem.size() > length && lower_case(stem.substr(stem.size() - length)) == extension) {
      stem.resize(stem.size() - length);
      break;
    }
  }
  if (stem.size() > 128) return std::nullopt;
  static const std::regex date(
      R"re((\d{4})[-_.]?(\d{2})[-_.]?(\d{2})[-_T ]?(\d{2})[-_:.h]?(\d{2})[-_:.m]?(\d{2})(?:[-_.,s]?(\d{1,9}))?(?!\d))re");
  static const std::regex number(R"re((\d+)(\.\d+)?)re");
  std::optional<double> out;
  for (std::sregex_iterator at(stem.begin(), stem.end(), date), end; at != end; ++at) {
    const auto place = static_cast<std::size_t>(at->position());
    if (place > 0 && is_digit(stem[place - 1])) continue;  // within a longer number
    if (const auto seconds = seconds_of(*at)) out = seconds;
  }
  if (out) return out;
  for (std::sregex_iterator at(stem.begin(), stem.end(), number), end; at != end; ++at) {
    const std::size_t digits = static_cast<std::size_t>((*at)[1].length());
    const bool fraction = (*at)[2].matched;
    if (fraction && digits <= 11) out = std::stod((*at)[0].str());
    if (!fraction && (digits == 10 || digits == 13 || digits == 16 || digits == 19)) {
      // The last digits of nanoseconds are lost in a double: divide the parts.
      const std::string text = (*at)[1].str();
      out = std::stod(text.substr(0, 10) + "." + text.substr(10) + "0");
    }
  }
  return out;
}

std::vector<ListedTime> read_frame_times(const fs::path& path) {
  const DelimitedLines lines(path, separator_of(read_whole_file(path)));
  std::vector<ListedTime> out;
  const auto time_of = [](const std::string& text) -> std::optional<double> {
    double value = 0.0;
    if (!parse_number(text, &value) || !std::isfinite(value)) return parse_date_time(text);
    const bool whole = std::all_of(text.begin(), text.end(), is_digit);
    return whole && text.size() >= 16 ? time_from_name(text) : std::optional<double>(value);
  };
  for (const DelimitedLine& line : lines.lines()) {
    std::vector<std::string> fields(line.fields.begin(), line.fields.end());
    // "2011-09-26 13:02:25.59" is one value.
    if (fields.size() >= 2 && parse_date_time(fields[0] + " " + fields[1])) {
      fields[0] += " " + fields[1];
      fields.erase(fields.begin() + 1);
    }
    std::optional<double> time = time_of(fields[0]);
    std::string name = fields.size() > 1 ? fields[1] : "";
    if (!time && fields.size() > 1) {
      time = time_of(fields[1]);
      name = fields[0];
    }
    if (!time && out.empty() && &line == &lines.lines().front()) continue;  // names of the columns
    if (!time) {
      lines.fail(line,
                 fmt::format("found '{}', expected a time in seconds, or a time and a file name",
                             printable(fields[0])));
    }
    double number = 0.0;
    if (parse_number(name, &number)) name.clear();  // a further column
    out.push_back({*time, fs::path(name).filename().string()});
  }
  if (out.empty()) throw InputError(path.string(), "found no time, expected one a line");
  return out;
}

}  // namespace camber
