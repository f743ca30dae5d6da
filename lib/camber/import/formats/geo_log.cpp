#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <regex>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/delimited_lines.h"
#include "camber/import/formats/detail/document.h"
#include "camber/import/formats/detail/subtitle_log.h"
#include "camber/import/formats/detail/xml_file.h"
#include "camber/import/formats/frame_files.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/import_common.h"
#include "camber/import/text_rows.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kRadians = 0.017453292519943295;  // of a degree
constexpr double kKnot = 1852.0 / 3600.0;          // m/s

/// Of a place: what receivers' makers state of solutions with fixed and with real ambiguities.
constexpr double kRtkFixedSigma = 0.02, kRtkFloatSigma = 0.4;  // m

bool is_place(double latitude, double longitude) {
  return std::abs(latitude) <= 90.0 && std::abs(longitude) <= 360.0;
}

// ---- GPX ----------------------------------------------------------------------------------------

GeoPoint gpx_point(const XmlFile& file, const pugi::xml_node& node) {
  GeoPoint out;
  out.latitude = file.attribute_number(node, "lat");
  out.longitude = file.attribute_number(node, "lon");
  if (!is_place(out.latitude, out.longitude)) {
    file.fail(node, fmt::format("found latitude {} and longitude {}, expected degrees",
                                out.latitude, out.longitude));
  }
  if (node.child("ele") && *node.child_value("ele")) out.altitude = file.child_number(node, "ele");
  out.time_text = node.child_value("time");
  if (const auto time = parse_date_time(out.time_text)) out.time_s = *time;
  pugi::xml_node speed = node.child("speed");  // GPX 1.0
  if (!speed) {                                // in an extension of 1.1
    speed = node.child("extensions").find_node([](const pugi::xml_node& n) {
      const std::string name = n.name();
      return name == "speed" ||
             (name.size() > 6 && name.compare(name.size() - 6, 6, ":speed") == 0);
    });
  }
  double value = 0.0;
  if (speed && parse_number(speed.child_value(), &value) && value >= 0.0) out.speed = value;
  return out;
}

GeoLog read_gpx(const std::string& text, const fs::path& path) {
  const XmlFile file = XmlFile::parse(text, path.string());
  const pugi::xml_node root = file.root();
  if (std::string(root.name()) != "gpx")
    file.fail(root, fmt::format("found <{}>, expected <gpx>", printable(root.name())));
  GeoLog out;
  out.form = "GPX";
  out.version = root.attribute("version").value();
  out.creator = root.attribute("creator").value();
  for (const pugi::xml_node& point : root.children("wpt"))
    out.waypoints.push_back(gpx_point(file, point));
  for (const pugi::xml_node& route : root.children("rte")) {
    out.routes.emplace_back();
    for (const pugi::xml_node& point : route.children("rtept"))
      out.routes.back().push_back(gpx_point(file, point));
  }
  for (const pugi::xml_node& track : root.children("trk")) {
    ++out.tracks;
    for (const pugi::xml_node& segment : track.children("trkseg")) {
      out.segments.emplace_back();
      for (const pugi::xml_node& point : segment.children("trkpt"))
        out.segments.back().push_back(gpx_point(file, point));
    }
  }
  return out;
}

// ---- NMEA ---------------------------------------------------------------------------------------

/// "5013.476" and "N" to degrees; nothing for empty or senseless fields.
std::optional<double> nmea_angle(const std::string& text, const std::string& side) {
  double value = 0.0;
  if (!parse_number(text, &value) || !(value >= 0.0 && value < 18100.0) || side.size() != 1)
    return std::nullopt;
  const double degrees = std::floor(value / 100.0);
  const double out = degrees + (value - 100.0 * degrees) / 60.0;
  return side == "S" || side == "W" ? -out : out;
}

/// "184353.07" to seconds of the day.
std::optional<double> nmea_time(const std::string& text) {
  double value = 0.0;
  if (text.size() < 6 || !parse_number(text, &value) || !(value >= 0.0 && value < 240001.0))
    return std::nullopt;
  const double hours = std::floor(value / 1e4), minutes = std::floor((value - 1e4 * hours) / 100.0);
  return 3600.0 * hours + 60.0 * minutes + (value - 1e4 * hours - 100.0 * minutes);
}

/// The sentences of a log in turn; times count on over midnight.
class NmeaReader {
 public:
  explicit NmeaReader(GeoLog* out) : out_(*out) { out_.segments.emplace_back(); }

  void take(const std::string& written) {
    const std::string line = sentence_of(written);
    const std::size_t star = line.rfind('*');
    if (line.size() < 7 || (line[0] != '$' && line[0] != '!') || star == std::string::npos ||
        star + 3 > line.size()) {
      ++out_.other_lines;
      return;
    }
    unsigned sum = 0;
    for (std::size_t i = 1; i < star; ++i) sum ^= static_cast<unsigned char>(line[i]);
    char hex[3] = {line[star + 1], line[star + 2], 0};
    char* end = nullptr;
    if (std::strtoul(hex, &end, 16) != sum || *end != 0) {
      ++out_.wrong_checksums;
      return;
    }
    std::vector<std::string> f(1);
    for (std::size_t i = 1; i < star; ++i) {
      if (line[i] == ',') {
        f.emplace_back();
      } else {
        f.back() += line[i];
      }
    }
    ++out_.sentences[f[0]];
    const std::string type = f[0].size() == 5 ? f[0].substr(2) : "";
    if (type == "GGA" && f.size() >= 10) gga(f);
    if (type == "RMC" && f.size() >= 10) rmc(f);
    if (type == "VTG" && f.size() >= 8) vtg(f);
  }

  void finish() {
    out_.times_of_day = !dated_;
    if (out_.segments[0].empty()) out_.segments[0] = std::move(of_rmc_);
  }

 private:
  /// Without what dash cameras and loggers put around it: "[1714607998000]$GPRMC,...*7F[...]".
  static std::string sentence_of(const std::string& line) {
    constexpr std::size_t kLongestPrefix = 40;
    const std::size_t start = line.find_first_of("$!");
    if (start == std::string::npos || start == 0 || start > kLongestPrefix) return line;
    if (line.substr(0, start).find_first_not_of("[]() \t,;:.-+TZ0123456789") != std::string::npos)
      return line;
    const std::size_t star = line.find('*', start);
    return line.substr(start, star == std::string::npos ? star : star + 3 - start);
  }

  double clock(double of_day) {
    if (of_day < last_ - 43200.0) day_ += 86400.0;
    last_ = of_day;
    return day_ + of_day;
  }

  void gga(const std::vector<std::string>& f) {
    const auto latitude = nmea_angle(f[2], f[3]), longitude = nmea_angle(f[4], f[5]);
    double quality = 0.0;
    const auto time = nmea_time(f[1]);
    if (!latitude || !longitude || !time || !parse_number(f[6], &quality) || quality < 1.0) return;
    GeoPoint point;
    point.latitude = *latitude;
    point.longitude = *longitude;
    parse_number(f[9], &point.altitude);
    if (quality == 4.0) point.sigma = kRtkFixedSigma;
    if (quality == 5.0) point.sigma = kRtkFloatSigma;
    point.time_text = f[1];
    point.time_s = clock(*time);
    out_.segments[0].push_back(std::move(point));
  }

  void rmc(const std::vector<std::string>& f) {
    double speed = 0.0;
    if (f[2] != "A") return;
    ++out_.valid_rmc;
    const auto time = nmea_time(f[1]);
    if (f[9].size() == 6 && time && !dated_) {
      // The first date; the day goes on by itself.
      const auto midnight = parse_date_time("20" + f[9].substr(4, 2) + f[9].substr(2, 2) +
                                            f[9].substr(0, 2) + "T000000");
      if (midnight) {
        for (GeoPoint& p : out_.segments[0]) p.time_s += *midnight - day_;
        for (GeoPoint& p : of_rmc_) p.time_s += *midnight - day_;
        day_ = *midnight;
        dated_ = true;
      }
    }
    if (!time) return;
    const double now = clock(*time);
    if (parse_number(f[7], &speed) && speed >= 0.0) add_speed(now, speed * kKnot);
    const auto latitude = nmea_angle(f[3], f[4]), longitude = nmea_angle(f[5], f[6]);
    if (!latitude || !longitude) return;
    GeoPoint point;
    point.latitude = *latitude;
    point.longitude = *longitude;
    point.time_text = f[1];
    point.time_s = now;
    of_rmc_.push_back(std::move(point));
  }

  void vtg(const std::vector<std::string>& f) {
    double speed = 0.0;
    if (parse_number(f[7], &speed) && speed >= 0.0 && !out_.segments[0].empty() &&
        out_.valid_rmc == 0) {
      out_.segments[0].back().speed = speed / 3.6;
    }
  }

  void add_speed(double time, double speed) {
    GeoPoint point;
    point.time_s = time;
    point.speed = speed;
    out_.speeds.push_back(std::move(point));
  }

  GeoLog& out_;
  std::vector<GeoPoint> of_rmc_;  // for logs without GGA
  double day_ = 0.0, last_ = 0.0;
  bool dated_ = false;
};

GeoLog read_nmea(const std::string& text) {
  GeoLog out;
  out.form = "NMEA";
  NmeaReader reader(&out);
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    if (!line.empty()) reader.take(line);
  }
  reader.finish();
  return out;
}

// ---- RTKLIB -------------------------------------------------------------------------------------

/// What GPS time is ahead of UTC (IERS bulletins C), s.
double gps_ahead_of_utc(double time_s) {
  static const std::pair<const char*, double> kSteps[] = {{"2017-01-01T000000", 18.0},
                                                          {"2015-07-01T000000", 17.0},
                                                          {"2012-07-01T000000", 16.0},
                                                          {"2009-01-01T000000", 15.0}};
  for (const auto& [from, seconds] : kSteps) {
    if (time_s >= *parse_date_time(from)) return seconds;
  }
  return 14.0;
}

/// .pos of RTKLIB: comments of '%', of which the last names the columns, then date, time, latitude,
/// longitude, height, quality, satellites, standard deviations north, east and up.
GeoLog read_rtklib(const std::string& text, const fs::path& path) {
  GeoLog out;
  out.form = "RTKLIB";
  out.segments.emplace_back();
  bool gps_time = false;
  std::istringstream lines(text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    std::istringstream stream(line);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    if (words.empty()) continue;
    const std::string place = fmt::format("line {}", number);
    if (words[0][0] == '%') {
      const bool names = line.find("latitude") != std::string::npos ||
                         line.find("x-ecef") != std::string::npos ||
                         line.find("e-baseline") != std::string::npos;
      if (!names) continue;
      if (line.find("latitude(deg)") == std::string::npos) {
        throw InputError(path.string(), place,
                         "found other columns than latitude(deg) and longitude(deg), expected "
                         "RTKLIB's positions in degrees");
      }
      gps_time = line.find("GPST") != std::string::npos;
      continue;
    }
    const auto value = [&](std::size_t i, const char* what) {
      double read = 0.0;
      if (i >= words.size() || !parse_number(words[i], &read) || !std::isfinite(read)) {
        throw InputError(path.string(), place,
                         fmt::format("found '{}', expected {}",
                                     i < words.size() ? printable(words[i]) : "nothing", what));
      }
      return read;
    };
    GeoPoint point;
    if (words.size() < 5)
      throw InputError(path.string(), place,
                       fmt::format("found {} columns, expected date, time, latitude, longitude, "
                                   "height, ...",
                                   words.size()));
    point.time_text = words[0] + " " + words[1];
    if (const auto time = parse_date_time(point.time_text)) {
      point.time_s = *time;
    } else {  // week and seconds of it
      const double week = value(0, "a date, or a GPS week"),
                   of_week = value(1, "seconds of the week");
      point.time_s = *parse_date_time("1980-01-06T000000") + 604800.0 * week + of_week;
    }
    point.latitude = value(2, "a latitude in degrees");
    point.longitude = value(3, "a longitude in degrees");
    point.altitude = value(4, "a height");
    if (!is_place(point.latitude, point.longitude)) {
      throw InputError(path.string(), place, "found no latitude and longitude, expected degrees");
    }
    const double quality = words.size() > 5 ? value(5, "a quality") : 0.0;
    const double least = quality == 1.0 ? kRtkFixedSigma : quality == 2.0 ? 0.1 : 0.5;
    if (words.size() > 9) {
      const double north = value(7, "a standard deviation"),
                   east = value(8, "a standard deviation"), up = value(9, "a standard deviation");
      point.sigma = std::max(std::hypot(north, east) / std::sqrt(2.0), least);
      point.height_sigma = std::max(up, 1.5 * least);
    } else if (quality == 1.0) {
      point.sigma = kRtkFixedSigma;
    }
    out.segments[0].push_back(std::move(point));
  }
  if (gps_time && !out.segments[0].empty())
    out.leap_seconds = gps_ahead_of_utc(out.segments[0].front().time_s);
  return out;
}

// ---- CSV ----------------------------------------------------------------------------------------

/// Units that may stand behind a name, in brackets, and what one is.
using Units = std::map<std::string, double>;
const Units kDegrees = {{"deg", 1.0},    {"degree", 1.0},         {"degrees", 1.0},
                        {"\u00b0", 1.0}, {"decimaldegrees", 1.0}, {"dd", 1.0},
                        {"wgs84", 1.0}};
const Units kLengths = {{"m", 1.0},      {"meter", 1.0}, {"meters", 1.0}, {"metre", 1.0},
                        {"metres", 1.0}, {"ft", 0.3048}, {"feet", 0.3048}};
const Units kSpeeds = {{"m/s", 1.0},       {"mps", 1.0},        {"ms", 1.0},
                       {"ms1", 1.0},       {"km/h", 1.0 / 3.6}, {"kmh", 1.0 / 3.6},
                       {"kph", 1.0 / 3.6}, {"kmph", 1.0 / 3.6}, {"mph", 0.44704},
                       {"mi/h", 0.44704},  {"kn", kKnot},       {"kt", kKnot},
                       {"kts", kKnot},     {"knots", kKnot}};

/// A column and what one of its units is.
struct UnitColumn {
  std::size_t at = 0;
  double unit = 1.0;
};

/// Columns of a table by their plain names.
struct Columns {
  std::map<std::string, std::size_t> at;
  std::map<std::string, std::pair<std::string, std::size_t>> with_unit;  ///< name: unit, column
  explicit Columns(const DelimitedLine& header) {
    for (std::size_t i = 0; i < header.fields.size(); ++i) {
      const std::string name = plain_name(std::string(header.fields[i]));
      at.emplace(name, i);
      const std::size_t open = name.find_first_of("([");
      if (open == std::string::npos || open == 0 || (name.back() != ')' && name.back() != ']')) {
        continue;
      }
      with_unit.emplace(name.substr(0, open),
                        std::pair(name.substr(open + 1, name.size() - open - 2), i));
    }
  }
  /// One of the names alone, in the first of the units, or with a unit behind it.
  std::optional<UnitColumn> find(std::initializer_list<const char*> names,
                                 const Units& units) const {
    if (const auto plain = find(names)) return UnitColumn{*plain, 1.0};
    for (const char* name : names) {
      const auto found = with_unit.find(name);
      if (found == with_unit.end()) continue;
      const auto unit = units.find(found->second.first);
      if (unit != units.end()) return UnitColumn{found->second.second, unit->second};
    }
    return std::nullopt;
  }
  std::optional<std::size_t> find(std::initializer_list<const char*> names) const {
    for (const char* name : names) {
      if (const auto found = at.find(name); found != at.end()) return found->second;
    }
    return std::nullopt;
  }
};

/// Time of a row: seconds, a date with a time of day, or these in two columns.
class TimeColumns {
 public:
  explicit TimeColumns(const Columns& columns)
      : time_(columns.find({"times",
                            "time",
                            "t",
                            "timestamp",
                            "sec",
                            "seconds",
                            "utc",
                            "datetime",
                            "gpstime",
                            "timesec",
                            "time(s)",
                            "time[s]",
                            "time(utc)",
                            "time[utc]",
                            "timeutc",
                            "utctime",
                            "timestamp(s)",
                            "timestamp[s]",
                            "timestamp(utc)",
                            "datetime(utc)",
                            "datetimeutc",
                            "dateandtime",
                            "date/time"})),
        nanoseconds_(columns.find(
            {"timestampns", "timestamp[ns]", "timens", "#timestamp[ns]", "#timestamp"})),
        date_(columns.find({"date"})) {}
  bool any() const { return time_ || nanoseconds_; }

  double read(const DelimitedLines& lines, const DelimitedLine& line) const {
    const std::size_t column = time_ ? *time_ : *nanoseconds_;
    if (column >= line.fields.size())
      lines.fail(line, fmt::format("found {} fields, expected a time", line.fields.size()));
    std::string text(line.fields[column]);
    double value = 0.0;
    const bool whole = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
    if (whole && text.size() >= 13) {
      if (const auto time = time_from_name(text)) return *time;
    }
    if (parse_number(lines.decimal(text), &value) && std::isfinite(value)) return value;
    if (date_ && *date_ < line.fields.size()) text = std::string(line.fields[*date_]) + " " + text;
    const auto time = parse_date_time(text);
    if (!time)
      lines.fail(
          line, column,
          fmt::format("found '{}', expected seconds, or a date and time of day", printable(text)));
    return *time;
  }

 private:
  std::optional<std::size_t> time_, nanoseconds_, date_;
};

GeoLog read_csv(const fs::path& path, char separator) {
  const DelimitedLines lines(path, separator);
  GeoLog out;
  out.form = "CSV";
  if (lines.lines().empty()) throw InputError(path.string(), "found no row, expected a table");
  const DelimitedLine& header = lines.lines().front();
  const Columns columns(header);
  for (const std::string_view field : header.fields) out.columns.emplace_back(field);
  const auto latitude = columns.find({"latitude", "lat"}, kDegrees),
             longitude = columns.find({"longitude", "lon", "lng", "long"}, kDegrees);
  if (!latitude || !longitude)
    lines.fail(header, "found no columns latitude and longitude, expected both");
  const auto altitude = columns.find({"altitude", "alt", "elevation", "ele", "height"}, kLengths);
  const auto speed = columns.find({"speed", "speedms", "speedmps", "velocity"}, kSpeeds);
  const auto frame = columns.find({"frame", "frameid"});
  const auto sigma = columns.find({"sigma", "sigmam", "accuracy", "horizontalaccuracy"}, kLengths);
  const TimeColumns times(columns);
  out.segments.emplace_back();
  for (std::size_t i = 1; i < lines.lines().size(); ++i) {
    const DelimitedLine& line = lines.lines()[i];
    GeoPoint point;
    point.latitude = lines.number(line, latitude->at, "a latitude in degrees");
    point.longitude = lines.number(line, longitude->at, "a longitude in degrees");
    if (!is_place(point.latitude, point.longitude))
      lines.fail(line, latitude->at, "found no latitude and longitude, expected degrees");
    const auto optional = [&](const std::optional<UnitColumn>& column, double* value) {
      if (column && column->at < line.fields.size() && !line.fields[column->at].empty())
        *value = column->unit * lines.number(line, column->at, "a number");
    };
    optional(altitude, &point.altitude);
    optional(speed, &point.speed);
    optional(sigma, &point.sigma);
    if (point.sigma <= 0.0) {
      lines.fail(line, sigma->at, "found no positive standard deviation, expected one");
    }
    if (frame) point.frame = lines.integer(line, *frame, 0, 2000000000, "a frame id");
    if (times.any()) point.time_s = times.read(lines, line);
    out.segments[0].push_back(std::move(point));
  }
  return out;
}

// ---- speeds -------------------------------------------------------------------------------------

/// Standard deviation of a speed that is a difference of two fixes: receivers are good to a few
/// tenths of a metre from one second to the next.
constexpr double kFixDifferenceSigma = 0.5;  // m

constexpr double kFastest = 100.0;  // m/s

double speed_sigma(double speed) { return std::max(0.1, 0.02 * speed); }

void add_segment(const std::vector<GeoPoint>& points, std::vector<SpeedSample>* out) {
  const bool stated = std::any_of(points.begin(), points.end(),
                                  [](const GeoPoint& p) { return std::isfinite(p.speed); });
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!std::isfinite(points[i].time_s)) continue;
    if (stated) {
      if (std::isfinite(points[i].speed))
        out->push_back({points[i].time_s, points[i].speed, speed_sigma(points[i].speed)});
      continue;
    }
    if (i == 0) continue;
    const double span = points[i].time_s - points[i - 1].time_s;
    if (!(span > 0.0 && span < 10.0)) continue;
    const double speed = great_circle_distance(points[i - 1], points[i]) / span;
    out->push_back({0.5 * (points[i].time_s + points[i - 1].time_s), speed,
                    std::hypot(speed_sigma(speed), kFixDifferenceSigma / span)});
  }
}

/// Rows without names of columns are time, speed and perhaps its standard deviation; what is not
/// like these needs names.
void require_bare_speeds(const DelimitedLines& lines) {
  constexpr double kLeastStep = 1e-3;  // s, on average
  const auto fail = [&](const DelimitedLine& line, const std::string& found) {
    lines.fail(line, "found " + found +
                         " in a table without a line of names, expected one: time and speed (m/s), "
                         "speed_kmh or speed_mph");
  };
  std::vector<double> times;
  for (const DelimitedLine& line : lines.lines()) {
    std::size_t count = line.fields.size();
    if (count > 2 && line.fields.back().empty()) --count;  // a separator at the end
    if (count > 3 || count < 2) fail(line, fmt::format("{} columns", count));
    times.push_back(lines.number(line, 0, "a time in seconds"));
    const std::size_t n = times.size();
    const bool turns =
        n > 2 && !((times[n - 1] - times[n - 2]) * (times[n - 2] - times[n - 3]) > 0.0);
    if (turns || (n == 2 && times[1] == times[0])) {
      fail(line, fmt::format("{} behind {} in the place of a time", times[n - 1], times[n - 2]));
    }
    const double speed = std::abs(lines.number(line, 1, "a speed"));
    if (speed > kFastest) fail(line, fmt::format("{}, no speed of a vehicle in m/s,", speed));
    if (count == 3) {
      const double sigma = lines.number(line, 2, "a standard deviation");
      if (!(sigma > 0.0 && sigma <= std::max(1.0, speed)))
        fail(line, fmt::format("{} in the place of a standard deviation", sigma));
    }
  }
  const double span = std::abs(times.back() - times.front());
  if (times.size() > 1 && span < kLeastStep * static_cast<double>(times.size() - 1))
    fail(lines.lines().back(), fmt::format("times that span {} s", span));
}

SpeedLog speeds_of_table(const fs::path& path, char separator) {
  const DelimitedLines lines(path, separator);
  SpeedLog out;
  out.form = "CSV";
  double value = 0.0;
  const DelimitedLine& first = lines.lines().front();
  const bool bare = parse_number(first.fields[0], &value);
  std::size_t time = 0, speed = 1;
  std::optional<std::size_t> sigma;
  double unit = 1.0;
  std::optional<TimeColumns> times;
  if (bare) {
    require_bare_speeds(lines);
    if (first.fields.size() > 2) sigma = 2;
  } else {
    const Columns columns(first);
    times.emplace(columns);
    auto at = columns.find({"speed", "speedms", "speedmps", "speedm/s", "velocity", "v", "vf",
                            "mps", "m/s", "forwardspeed", "groundspeed", "gpsspeed"},
                           kSpeeds);
    const auto take = [&](std::initializer_list<const char*> names, double of_unit) {
      if (const auto found = at ? std::nullopt : columns.find(names)) {
        at = UnitColumn{*found, of_unit};
      }
    };
    take({"speedkmh", "kmh", "km/h", "speedkm/h", "kph", "speedkph"}, 1.0 / 3.6);
    take({"speedmph", "mph"}, 0.44704);
    take({"speedknots", "knots", "speedkn"}, kKnot);
    if (!times->any() || !at)
      lines.fail(first,
                 "found no columns of a time and a speed, expected time and speed (m/s), speed_kmh "
                 "or speed_mph");
    speed = at->at;
    unit = at->unit;
    sigma = columns.find({"sigma", "speedsigma", "speedstd", "std", "stddev"});
  }
  for (std::size_t i = bare ? 0 : 1; i < lines.lines().size(); ++i) {
    const DelimitedLine& line = lines.lines()[i];
    SpeedSample sample;
    sample.time_s = bare ? lines.number(line, time, "a time in seconds") : times->read(lines, line);
    sample.speed = unit * lines.number(line, speed, "a speed");
    if (!(std::abs(sample.speed) <= 1000.0))
      lines.fail(line, speed,
                 fmt::format("found {} m/s, expected a speed up to 1000", sample.speed));
    sample.speed = std::abs(sample.speed);  // backwards
    sample.sigma = speed_sigma(sample.speed);
    if (sigma && *sigma < line.fields.size() && !line.fields[*sigma].empty()) {
      sample.sigma = unit * lines.number(line, *sigma, "a standard deviation");
      if (!(sample.sigma > 0.0))
        lines.fail(line, *sigma, "found no positive standard deviation, expected one");
    }
    out.samples.push_back(sample);
  }
  return out;
}

}  // namespace

double great_circle_distance(const GeoPoint& a, const GeoPoint& b) {
  const double p = a.latitude * kRadians, q = b.latitude * kRadians;
  const double dp = 0.5 * (q - p), dl = 0.5 * (b.longitude - a.longitude) * kRadians;
  const double h =
      std::sin(dp) * std::sin(dp) + std::cos(p) * std::cos(q) * std::sin(dl) * std::sin(dl);
  return 2.0 * 6371008.8 * std::asin(std::min(1.0, std::sqrt(h)));
}

namespace {

/// Whether the first line is a sentence of NMEA behind a time stamp in brackets or alone.
bool has_stamped_sentences(const std::string& text) {
  static const std::regex pattern(R"(^[\[\]() \t,;:.+TZ0-9-]{1,40}\$[A-Z]{5},)");
  const std::string start = text.substr(0, std::min<std::size_t>(text.find('\n'), 120));
  return std::regex_search(start, pattern);
}

/// Whether a file is a log of a receiver rather than a table.
bool is_log(const std::string& text, std::size_t first) {
  return text[first] == '<' || text[first] == '$' || text[first] == '%' ||
         text.find("\n$G") != std::string::npos || has_stamped_sentences(text) ||
         are_subtitles(text);
}

}  // namespace

GeoLog read_geo_log(const fs::path& path) {
  const std::string text = read_whole_file(path);
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string::npos)
    throw InputError(path.string(), "found an empty file, expected positions");
  if (text[first] == '<') return read_gpx(text, path);
  if (text[first] == '$' || text[first] == '!' || text.find("\n$G") != std::string::npos)
    return read_nmea(text);
  if (has_stamped_sentences(text)) return read_nmea(text);
  if (text[first] == '%') return read_rtklib(text, path);
  if (are_subtitles(text)) return read_subtitle_log(text);
  return read_csv(path, separator_of(text));
}

std::vector<SpeedSample> speeds_of_log(const GeoLog& log) {
  std::vector<SpeedSample> out;
  if (!log.speeds.empty()) {
    add_segment(log.speeds, &out);
  } else {
    for (const std::vector<GeoPoint>& segment : log.segments) add_segment(segment, &out);
  }
  return out;
}

SpeedLog read_speeds(const fs::path& path) {
  const std::string text = read_whole_file(path);
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  if (first == std::string::npos)
    throw InputError(path.string(), "found an empty file, expected times and speeds");
  SpeedLog out;
  if (is_log(text, first)) {
    const GeoLog read = read_geo_log(path);
    out.form = read.form;
    out.times_of_day = read.form == "NMEA" && read.times_of_day;
    out.leap_seconds = read.leap_seconds;
    out.samples = speeds_of_log(read);
  } else {
    const DelimitedLines probe(path, separator_of(text));
    if (probe.lines().empty())
      throw InputError(path.string(), "found no row, expected times and speeds");
    out = speeds_of_table(path, separator_of(text));
  }
  if (out.samples.empty())
    throw InputError(path.string(), "found no time with a speed, expected at least one");
  std::stable_sort(out.samples.begin(), out.samples.end(),
                   [](const SpeedSample& a, const SpeedSample& b) { return a.time_s < b.time_s; });
  return out;
}

bool is_oxts(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return true;
  if (path.extension() != ".txt" || !fs::is_regular_file(path, error)) return false;
  const TextRows rows(path);
  return !rows.rows().empty() && rows.rows().front().words.size() == 30;
}

std::vector<OxtsRecord> read_oxts(const fs::path& path) {
  const auto record = [](const TextRows& rows, const TextRow& row, int number) {
    if (row.words.size() != 30)
      rows.fail(row, fmt::format("found {} columns, expected the 30 of oxts", row.words.size()));
    const auto value = [&](std::size_t i) { return rows.number(row, row.words[i], "a number"); };
    OxtsRecord out;
    out.number = number;
    out.latitude = value(0);
    out.longitude = value(1);
    out.altitude = value(2);
    out.roll = value(3);
    out.pitch = value(4);
    out.yaw = value(5);
    out.forward_speed = value(8);
    out.position_accuracy = std::max(value(23), 0.0);
    return out;
  };
  std::vector<OxtsRecord> out;
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    const TextRows rows(path);
    for (std::size_t i = 0; i < rows.rows().size(); ++i)
      out.push_back(record(rows, rows.rows()[i], static_cast<int>(i)));
    return out;
  }
  const fs::path folder = fs::is_directory(path / "data", error) ? path / "data" : path;
  for (const auto& [number, file] : numbered_files(folder, {".txt"}, "oxts records")) {
    const TextRows rows(file);
    if (rows.rows().size() != 1)
      throw InputError(file.string(),
                       fmt::format("found {} rows, expected one record", rows.rows().size()));
    out.push_back(record(rows, rows.rows().front(), number));
  }
  return out;
}

std::vector<Attitude> read_attitudes(const fs::path& path) {
  const DelimitedLines lines(path, separator_of(read_whole_file(path)));
  if (lines.lines().empty())
    throw InputError(path.string(), "found no row, expected roll and pitch by time or frame");
  const DelimitedLine& header = lines.lines().front();
  const Columns columns(header);
  const TimeColumns times(columns);
  const auto frame = columns.find({"frame", "id", "frameid"});
  auto roll = columns.find({"roll", "rollrad"}), pitch = columns.find({"pitch", "pitchrad"});
  double unit = 1.0;
  if (!roll && !pitch) {
    roll = columns.find({"rolldeg"});
    pitch = columns.find({"pitchdeg"});
    unit = kRadians;
  }
  if (!roll || !pitch || (!frame && !times.any())) {
    lines.fail(header,
               "found no columns time or frame, roll and pitch (or roll_deg and pitch_deg), "
               "expected them");
  }
  std::vector<Attitude> out;
  for (std::size_t i = 1; i < lines.lines().size(); ++i) {
    const DelimitedLine& line = lines.lines()[i];
    Attitude one;
    if (frame) {
      one.frame = lines.integer(line, *frame, 0, 2000000000, "a frame id");
    } else {
      one.time_s = times.read(lines, line);
    }
    one.roll = unit * lines.number(line, *roll, "a roll");
    one.pitch = unit * lines.number(line, *pitch, "a pitch");
    if (!(std::abs(one.roll) < 1.6 && std::abs(one.pitch) < 1.6))
      lines.fail(line,
                 "found a roll or pitch beyond 90 degrees, expected radians, or columns roll_deg "
                 "and pitch_deg");
    out.push_back(one);
  }
  if (out.empty())
    throw InputError(path.string(), "found no row, expected roll and pitch by time or frame");
  std::stable_sort(out.begin(), out.end(),
                   [](const Attitude& a, const Attitude& b) { return a.time_s < b.time_s; });
  return out;
}

Eigen::Vector3d up_in_camera(double roll, double pitch) {
  return {-std::sin(roll) * std::cos(pitch), -std::cos(roll) * std::cos(pitch), -std::sin(pitch)};
}

}  // namespace camber
