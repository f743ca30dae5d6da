#include "camber/import/film_telemetry.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/detail/samples_in_time.h"
#include "camber/import/formats/gpmf.h"
#include "camber/import/formats/mp4_film.h"
#include "camber/import/formats/trajectory.h"
#include "camber/scene/camera_up.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kPositionGap = 3.0, kGravityGap = 1.0;  // s, between samples
constexpr double kDay = 86400.0;                         // s
/// Of the time at which a film says it was made: whole seconds of a clock that somebody set.
constexpr double kMadeSigma = 1.0;  // s

/// What was found, its times on the film's clock.
struct Telemetry {
  fs::path file;
  GeoLog log;
  std::vector<CameraTelemetry::Gravity> gravity;
  std::vector<std::string> phrases;  // on what it is
  double clock_sigma = 0.0;          // s
  bool in_step = true;               // with the frames; else the phrases say why not

  bool empty() const {
    return log.segments.front().empty() && log.speeds.empty() && gravity.empty();
  }
};

/// Adds to all times.
void shift_by(double seconds, Telemetry* telemetry) {
  for (auto& segment : telemetry->log.segments) {
    for (GeoPoint& point : segment) point.time_s += seconds;
  }
  for (GeoPoint& point : telemetry->log.speeds) point.time_s += seconds;
  for (auto& sample : telemetry->gravity) sample.time_s += seconds;
}

double rate_of(const std::vector<double>& times) {
  const double span = times.size() > 1 ? times.back() - times.front() : 0.0;
  return span > 0.0 ? static_cast<double>(times.size() - 1) / span : 0.0;
}

std::vector<double> times_of(const GeoLog& log) {
  std::vector<double> out;
  const auto take = [&](const std::vector<GeoPoint>& points) {
    for (const GeoPoint& point : points) {
      if (std::isfinite(point.time_s)) out.push_back(point.time_s);
    }
  };
  for (const auto& segment : log.segments) take(segment);
  if (out.empty()) take(log.speeds);
  std::sort(out.begin(), out.end());
  return out;
}

std::optional<Telemetry> in_film(const fs::path& film, const std::optional<Mp4Film>& boxes,
                                 const TelemetryOptions& options) {
  if (!boxes || boxes->telemetry.empty()) return std::nullopt;
  CameraTelemetry read = read_gpmf(film, boxes->telemetry);
  Telemetry out;
  out.file = film;
  out.log = std::move(read.log);
  out.gravity = std::move(read.gravity);
  const std::vector<double> times = times_of(out.log);
  std::string phrase = read.device.empty() ? "" : printable(read.device, 32) + ", ";
  if (times.empty()) {
    phrase += read.without_fix > 0 ? "GPS without a fix" : "no GPS";
  } else {
    phrase += fmt::format("GPS at {:.3g} Hz", rate_of(times));
    if (read.fix > 0) phrase += fmt::format(", fix in {} dimensions", read.fix);
    if (read.dilution > 0.0) phrase += fmt::format(", dilution of precision {:.2g}", read.dilution);
    if (read.without_fix > 0) phrase += fmt::format(", {} times without a fix", read.without_fix);
  }
  out.phrases.push_back(phrase);
  shift_by(options.offset.value_or(0.0), &out);
  return out;
}

/// Joins a log of the world's time with the film.
/// @param last  s, of the last frame
void join_clocks(const std::optional<Mp4Film>& boxes, double first, double last,
                 const TelemetryOptions& options, Telemetry* telemetry) {
  const std::vector<double> times = times_of(telemetry->log);
  if (times.empty()) {
    telemetry->in_step = false;
    telemetry->phrases.emplace_back("not used: it has no times");
    return;
  }
  if (options.offset) return shift_by(*options.offset - times.front(), telemetry);
  const std::string hint =
      "--telemetry-offset SECONDS states when its first position was, since the first frame";
  telemetry->in_step = boxes && boxes->created_s;
  if (!telemetry->in_step) {
    telemetry->phrases.push_back("not used: the film does not say when it was made; " + hint);
    return;
  }
  double made = *boxes->created_s;
  if (telemetry->log.times_of_day) made += kDay * std::round((times.front() - made) / kDay);
  const bool covered =
      times.front() - kPositionGap <= made + first && made + last <= times.back() + kPositionGap;
  if (!covered) {
    telemetry->in_step = false;
    telemetry->phrases.push_back(
        fmt::format("not used: its {:.0f} s begin {:.0f} s {} the film says it was made; ",
                    times.back() - times.front(), std::abs(times.front() - made),
                    times.front() < made ? "before" : "after") +
        hint);
    return;
  }
  telemetry->clock_sigma = kMadeSigma;
  telemetry->phrases.push_back(
      fmt::format("joined to {:.0f} s by when the film says it was made (as by --telemetry-offset "
                  "{:.0f})",
                  kMadeSigma, times.front() - made));
  shift_by(-made, telemetry);
}

/// The log that lies beside the film.
std::optional<Telemetry> beside_film(const fs::path& film, const std::optional<Mp4Film>& boxes,
                                     double first, double last, const TelemetryOptions& options) {
  for (const char* extension : {".gpx", ".GPX", ".nmea", ".NMEA", ".srt", ".SRT"}) {
    fs::path file = film;
    file.replace_extension(extension);
    std::error_code error;
    if (file == film || !fs::is_regular_file(file, error)) continue;
    Telemetry out;
    out.file = file;
    out.log = read_geo_log(file);
    if (out.log.segments.empty()) out.log.segments.emplace_back();
    if (out.log.of_film && out.empty()) continue;  // what people say in the film
    if (out.empty()) throw InputError(file.string(), "found no position, expected some");
    std::string form = out.log.form == "subtitles" ? "positions in subtitles" : out.log.form;
    const double rate = rate_of(times_of(out.log));
    if (rate > 0.0) form += fmt::format(" at {:.3g} Hz", rate);
    out.phrases.push_back(form);
    if (out.log.of_film) {
      shift_by(options.offset.value_or(0.0), &out);
    } else {
      join_clocks(boxes, first, last, options, &out);
    }
    return out;
  }
  return std::nullopt;
}

/// Errors in time are errors of the places that were passed meanwhile, and of the speeds.
void widen_by_clock(double clock_sigma, double position_sigma, std::vector<GeoPoint>* points,
                    std::vector<SpeedSample>* speeds) {
  if (!(clock_sigma > 0.0)) return;
  const std::vector<SpeedSample> given = *speeds;
  for (std::size_t i = 0; i < given.size(); ++i) {
    const SpeedSample &a = given[i > 0 ? i - 1 : i], &b = given[std::min(i + 1, given.size() - 1)];
    const double span = b.time_s - a.time_s;
    const double rate = span > 0.0 ? std::abs(b.speed - a.speed) / span : 0.0;
    (*speeds)[i].sigma = std::hypot(given[i].sigma, clock_sigma * rate);
  }
  for (GeoPoint& point : *points) {
    const auto behind = std::lower_bound(
        given.begin(), given.end(), point.time_s,
        [](const SpeedSample& sample, double time) { return sample.time_s < time; });
    const double speed = given.empty()           ? 0.0
                         : behind == given.end() ? given.back().speed
                                                 : behind->speed;
    const double sigma = std::isfinite(point.sigma) ? point.sigma : position_sigma;
    point.sigma = std::hypot(sigma, clock_sigma * speed);
  }
}

template <typename Samples>
bool any_frame_in(const Samples& samples, const Scene& scene, double gap) {
  return std::any_of(scene.frames.begin(), scene.frames.end(), [&](const SceneFrame& frame) {
    return frame.time_s && place_in(samples, *frame.time_s, gap);
  });
}

std::size_t put_gravity(const std::vector<CameraTelemetry::Gravity>& samples, double sigma,
                        Scene& scene) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& sample : samples) mean += sample.vector;
  // A camera that films a road stands upright.
  const double sense = mean.y() > 0.0 ? -1.0 : 1.0;
  std::size_t count = 0;
  for (SceneFrame& frame : scene.frames) {
    if (!frame.time_s) continue;
    const auto place = place_in(samples, *frame.time_s, kGravityGap);
    if (!place) continue;
    const auto& [at, share] = *place;
    const Eigen::Vector3d &a = samples[at].vector, &b = samples[share > 0.0 ? at + 1 : at].vector;
    const Eigen::Vector3d up = (sense * ((1.0 - share) * a + share * b)).normalized();
    if (!up.allFinite() || why_not_up(up) != nullptr) continue;
    frame.up = up;
    // Its right may be the camera's left: then it is wrong by twice its lean.
    frame.up_sigma = std::hypot(sigma, 2.0 * up.x());
    ++count;
  }
  return count;
}

/// Gives the frames what is theirs. @return a phrase on it.
std::string put(const Telemetry& telemetry, bool upright, const OwnDataOptions& options,
                OwnImport& out) {
  Scene& scene = out.scene;
  std::vector<std::string> given, kept;
  std::vector<GeoPoint> points;
  for (const auto& segment : telemetry.log.segments) {
    points.insert(points.end(), segment.begin(), segment.end());
  }
  const auto earlier = [](const auto& a, const auto& b) { return a.time_s < b.time_s; };
  points.erase(std::remove_if(points.begin(), points.end(),
                              [](const GeoPoint& p) { return !std::isfinite(p.time_s); }),
               points.end());
  std::stable_sort(points.begin(), points.end(), earlier);
  std::vector<SpeedSample> speeds = speeds_of_log(telemetry.log);
  std::stable_sort(speeds.begin(), speeds.end(), earlier);
  widen_by_clock(telemetry.clock_sigma, options.gnss.sigma, &points, &speeds);
  const bool own_positions = options.gnss.file.empty() && options.gnss.points.empty();
  if (own_positions && options.gnss.projection && any_frame_in(points, scene, kPositionGap)) {
    GnssOptions gnss = options.gnss;
    gnss.file = telemetry.file;
    gnss.form = telemetry.log.form;
    gnss.points = points;
    gnss.offset.clear();
    try {
      put_gnss(scene, gnss, out);
      given.emplace_back("positions");
    } catch (const Error& error) {
      out.missing.push_back(fmt::format("positions: {}", error.what()));
    }
  }
  if (options.speed.empty() && put_speeds(scene, speeds, kPositionGap) > 0) {
    given.emplace_back("speeds");
  }
  if (options.up.empty() && upright &&
      put_gravity(telemetry.gravity, options.up_sigma, scene) > 0) {
    given.emplace_back("gravity");
  }
  if (given.empty()) return "nothing of it is taken";
  return fmt::format("the frames get its {}", fmt::join(given, ", "));
}

}  // namespace

void put_film_telemetry(const fs::path& film, bool upright, const OwnDataOptions& options,
                        OwnImport& out) {
  if (!options.telemetry.use || out.scene.frames.empty()) return;
  const double first = out.scene.frames.front().time_s.value_or(0.0);
  const double last = out.scene.frames.back().time_s.value_or(0.0);
  try {
    const std::optional<Mp4Film> boxes = read_mp4_film(film);
    std::optional<Telemetry> found = in_film(film, boxes, options.telemetry);
    if (!found || found->empty()) {
      std::optional<Telemetry> beside = beside_film(film, boxes, first, last, options.telemetry);
      if (beside) found = std::move(beside);
    }
    if (!found) return;
    if (found->in_step) found->phrases.push_back(put(*found, upright, options, out));
    out.telemetry =
        fmt::format("telemetry of {}: {}", printable(found->file.filename().string(), 64),
                    fmt::join(found->phrases, "; "));
  } catch (const InputError& error) {
    out.telemetry =
        fmt::format("telemetry, not used: {} (--no-telemetry leaves it alone)", error.what());
  }
  out.found.push_back(out.telemetry);
}

}  // namespace camber
