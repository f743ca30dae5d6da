#include "camber/import/formats/detail/subtitle_log.h"

#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "camber/core/lower_case.h"
#include "camber/import/text_rows.h"

namespace camber {
namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// A decimal number in a text.
struct Found {
  double value = 0.0;
  std::size_t begin = 0, end = 0;
};

/// The number that begins at `at`.
std::optional<Found> number_at(std::string_view text, std::size_t at) {
  std::size_t end = at;
  if (end < text.size() && (text[end] == '-' || text[end] == '+')) ++end;
  const std::size_t digits = end;
  while (end < text.size() && is_digit(text[end])) ++end;
  if (end == digits) return std::nullopt;
  if (end + 1 < text.size() && text[end] == '.' && is_digit(text[end + 1])) {
    for (++end; end < text.size() && is_digit(text[end]);) ++end;
  }
  Found out;
  out.begin = at;
  out.end = end;
  const std::size_t sign = text[at] == '+' ? 1 : 0;
  if (!parse_number(text.substr(at + sign, end - at - sign), &out.value)) return std::nullopt;
  return out;
}

/// The number behind the first of the words that has one: "lat: 48.1", "latitude=48.1".
std::optional<Found> number_after(std::string_view text, std::initializer_list<const char*> words) {
  for (const std::string_view word : words) {
    for (std::size_t at = text.find(word); at != std::string_view::npos;
         at = text.find(word, at + 1)) {
      if (at > 0 && is_letter(text[at - 1])) continue;
      const std::size_t behind = text.find_first_not_of(" \t:=", at + word.size());
      if (behind == std::string_view::npos) continue;
      if (const auto found = number_at(text, behind)) return found;
    }
  }
  return std::nullopt;
}

/// Degrees beside letters of the compass: "n48.1374 e: 11.5755" or "48.1374 n, 11.5755 e". Only
/// numbers with four decimals count: letters and numbers stand beside each other elsewhere, too.
bool take_compass(std::string_view text, GeoPoint* out) {
  constexpr std::size_t kLeastDecimals = 4;
  struct Letter {
    std::size_t at;
    bool north;
    double sign;
  };
  std::vector<Letter> letters;
  std::vector<Found> numbers;
  for (std::size_t at = 0; at < text.size(); ++at) {
    const char c = text[at];
    const char before = at > 0 ? text[at - 1] : ' ',
               behind = at + 1 < text.size() ? text[at + 1] : ' ';
    if ((c == 'n' || c == 's' || c == 'e' || c == 'w') && !is_letter(before) &&
        !is_letter(behind)) {
      letters.push_back({at, c == 'n' || c == 's', c == 'n' || c == 'e' ? 1.0 : -1.0});
    }
    if (!is_digit(c) || is_digit(before) || before == '.') continue;
    const auto number = number_at(text, at);
    const std::size_t point = number ? text.find('.', at) : std::string_view::npos;
    if (number && point < number->end && number->end - point > kLeastDecimals) {
      numbers.push_back(*number);
    }
  }
  if (letters.empty() || numbers.empty()) return false;
  const bool letters_first = letters.front().at < numbers.front().begin;
  std::optional<double> latitude, longitude;
  for (const Found& number : numbers) {
    for (const Letter& letter : letters) {
      const std::size_t from = letters_first ? letter.at + 1 : number.end;
      const std::size_t to = letters_first ? number.begin : letter.at;
      const bool beside =
          from <= to &&
          text.substr(from, to - from).find_first_not_of(" :=\xC2\xB0") == std::string_view::npos;
      if (!beside) continue;
      std::optional<double>& place = letter.north ? latitude : longitude;
      if (!place) place = letter.sign * number.value;
    }
  }
  if (!latitude || !longitude) return false;
  out->latitude = *latitude;
  out->longitude = *longitude;
  return true;
}

/// Longitude, latitude and perhaps a height in brackets behind "gps".
bool take_brackets(std::string_view text, GeoPoint* out) {
  const std::size_t at = text.find("gps");
  const std::size_t open = at == std::string_view::npos ? at : text.find_first_not_of(" :", at + 3);
  if (open == std::string_view::npos || text[open] != '(') return false;
  const auto next = [&](std::size_t from) {
    const std::size_t begin = text.find_first_not_of(" ,", from);
    return begin == std::string_view::npos ? std::nullopt : number_at(text, begin);
  };
  const auto longitude = next(open + 1);
  const auto latitude = longitude ? next(longitude->end) : std::nullopt;
  if (!latitude) return false;
  out->longitude = longitude->value;
  out->latitude = latitude->value;
  return true;
}

bool take_position(std::string_view text, GeoPoint* out) {
  const auto latitude = number_after(text, {"latitude", "lat"});
  const auto longitude = number_after(text, {"longitude", "longtitude", "long", "lon", "lng"});
  if (latitude && longitude) {
    out->latitude = latitude->value;
    out->longitude = longitude->value;
  } else if (!take_brackets(text, out) && !take_compass(text, out)) {
    return false;
  }
  const bool none = out->latitude == 0.0 && out->longitude == 0.0;
  return !none && std::abs(out->latitude) <= 90.0 && std::abs(out->longitude) <= 180.0;
}

/// A speed, m/s; only with its unit.
std::optional<double> speed_in(std::string_view text) {
  const auto unit_at = [&](std::size_t at) {
    const std::size_t begin = text.find_first_not_of(" ", at);
    if (begin == std::string_view::npos) return 0.0;
    const std::string_view rest = text.substr(begin);
    for (const auto& [name, unit] : {std::pair("km/h", 1.0 / 3.6),
                                     {"kmh", 1.0 / 3.6},
                                     {"kph", 1.0 / 3.6},
                                     {"mph", 0.44704},
                                     {"m/s", 1.0}}) {
      if (rest.substr(0, std::string_view(name).size()) == name) return unit;
    }
    return 0.0;
  };
  if (const auto named = number_after(text, {"h.s", "speed", "spd"})) {
    const double unit = unit_at(named->end);
    if (unit > 0.0 && named->value >= 0.0) return unit * named->value;
  }
  for (std::size_t at = 0; at < text.size(); ++at) {
    if (!is_digit(text[at]) || (at > 0 && (is_digit(text[at - 1]) || text[at - 1] == '.'))) {
      continue;
    }
    const auto number = number_at(text, at);
    const double unit = number ? unit_at(number->end) : 0.0;
    // Metres a second may be those of a climb: they need a name.
    if (unit > 0.0 && unit != 1.0) return unit * number->value;
  }
  return std::nullopt;
}

/// "00:01:02,500 --> ...": seconds.
std::optional<double> begin_of(const std::string& line) {
  int hours = 0, minutes = 0, seconds = 0, fraction = 0;
  char separator = 0;
  if (line.find("-->") == std::string::npos) return std::nullopt;
  if (std::sscanf(line.c_str(), "%3d:%2d:%2d%c%3d", &hours, &minutes, &seconds, &separator,
                  &fraction) != 5) {
    return std::nullopt;
  }
  if (hours < 0 || minutes < 0 || seconds < 0 || fraction < 0) return std::nullopt;
  return 3600.0 * hours + 60.0 * minutes + seconds + 1e-3 * fraction;
}

/// Subtitles in turn.
class SubtitleReader {
 public:
  explicit SubtitleReader(GeoLog* out) : out_(*out) { out_.segments.emplace_back(); }

  void take(const std::string& line) {
    if (const auto time = begin_of(line)) {
      finish();
      time_ = time;
      return;
    }
    constexpr std::size_t kLongest = 4096;  // bytes, of a subtitle that states numbers
    if (time_ && text_.size() + line.size() < kLongest) text_ += lower_case(line) + ' ';
  }

  void finish() {
    GeoPoint point;
    if (time_ && take_position(text_, &point)) {
      point.time_s = *time_;
      if (const auto height = number_after(text_, {"abs_alt", "altitude", "alt"})) {
        point.altitude = height->value;
      }
      if (const auto speed = speed_in(text_)) point.speed = *speed;
      add(std::move(point));
    }
    time_.reset();
    text_.clear();
  }

 private:
  void add(GeoPoint point) {
    constexpr double kAgain = 1.0;  // s
    std::vector<GeoPoint>& points = out_.segments.front();
    if (!points.empty()) {
      const GeoPoint& last = points.back();
      const bool same = last.latitude == point.latitude && last.longitude == point.longitude;
      if (!(point.time_s > last.time_s) || (same && point.time_s < last.time_s + kAgain)) return;
    }
    points.push_back(std::move(point));
  }

  GeoLog& out_;
  std::optional<double> time_;
  std::string text_;
};

}  // namespace

bool are_subtitles(const std::string& text) {
  constexpr std::size_t kStart = 200;  // bytes
  const std::string start = text.substr(0, kStart);
  const std::size_t arrow = start.find("-->");
  const std::size_t first = start.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  return arrow != std::string::npos && first != std::string::npos && is_digit(start[first]);
}

GeoLog read_subtitle_log(const std::string& text) {
  GeoLog out;
  out.form = "subtitles";
  out.of_film = true;
  SubtitleReader reader(&out);
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    reader.take(line);
  }
  reader.finish();
  return out;
}

}  // namespace camber
