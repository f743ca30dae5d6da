#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/detail/samples_in_time.h"
#include "camber/import/import_common.h"
#include "camber/scene/georeference.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Of heights over places: the satellites are all above the receiver.
constexpr double kHeightFactor = 1.5;
constexpr double kLongestGap = 3.0;  // s, between positions

/// A position of the log, on the map.
struct GnssSample {
  double time_s = 0.0;
  MapPosition at;
};

struct GnssLog {
  std::string form;
  std::vector<GeoPoint> points;
  double leap_seconds = 0.0;     // of GeoLog
  std::vector<double> headings;  // rad from true east, counterclockwise; or empty
};

GnssLog read_log(const fs::path& file) {
  GnssLog out;
  if (is_oxts(file)) {
    out.form = "KITTI oxts";
    for (const OxtsRecord& record : read_oxts(file)) {
      GeoPoint point;
      point.latitude = record.latitude;
      point.longitude = record.longitude;
      point.altitude = record.altitude;
      point.frame = record.number;
      if (record.position_accuracy > 0.0) point.sigma = record.position_accuracy;
      out.points.push_back(point);
      out.headings.push_back(record.yaw);
    }
    return out;
  }
  const GeoLog log = read_geo_log(file);
  out.form = log.form;
  out.leap_seconds = log.leap_seconds;
  for (const auto& segment : log.segments) {
    out.points.insert(out.points.end(), segment.begin(), segment.end());
  }
  if (out.points.empty()) throw InputError(file.string(), "found no position, expected some");
  return out;
}

/// Seconds to add to the log's times.
double shift_of(const GnssLog& log, const Scene& scene, const std::string& offset) {
  if (offset.empty()) return 0.0;
  if (offset == "first") {
    if (!scene.frames.front().time_s) {
      throw UsageError("--gnss-offset first: the frames have no times, expected --rate or --times");
    }
    return *scene.frames.front().time_s - log.points.front().time_s;
  }
  char* end = nullptr;
  const double shift = std::strtod(offset.c_str(), &end);
  if (*end != 0 || !std::isfinite(shift)) {
    throw UsageError(
        fmt::format("--gnss-offset {}: expected seconds, or first", printable(offset)));
  }
  return shift;
}

std::vector<GnssSample> on_the_map(const GnssLog& log, const std::string& crs,
                                   const GnssOptions& options) {
  const std::vector<MapPlace> places = options.projection(crs, log.points);
  std::vector<GnssSample> out(log.points.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const GeoPoint& point = log.points[i];
    MapPosition& at = out[i].at;
    out[i].time_s = point.time_s;
    at.position = {places[i].east, places[i].north, point.altitude};
    at.sigma = std::isfinite(point.sigma) ? point.sigma : options.sigma;
    at.height_sigma =
        std::isfinite(point.height_sigma) ? point.height_sigma : kHeightFactor * at.sigma;
    at.heading_sigma = options.heading_sigma;
    if (!log.headings.empty()) {
      at.heading = std::remainder(log.headings[i] + places[i].convergence, 2.0 * M_PI);
    }
  }
  return out;
}

/// Between two samples of a receiver, whose errors have much in common.
MapPosition between(const MapPosition& a, const MapPosition& b, double share) {
  MapPosition out = a;
  out.position = (1.0 - share) * a.position + share * b.position;
  out.sigma = std::max(a.sigma, b.sigma);
  out.height_sigma = std::max(a.height_sigma, b.height_sigma);
  return out;
}

}  // namespace

void put_gnss(Scene& scene, const GnssOptions& options, OwnImport& out) {
  if (!options.projection) {
    throw std::invalid_argument("GnssOptions::projection is empty, expected a function");
  }
  GnssLog log;
  if (options.points.empty()) {
    log = read_log(options.file);
  } else {
    log.form = options.form;
    log.points = options.points;
  }
  const std::string crs = options.crs.empty()
                              ? utm_crs(log.points.front().latitude, log.points.front().longitude)
                              : options.crs;
  std::vector<GnssSample> samples = on_the_map(log, crs, options);
  std::size_t count = 0;
  std::string clock;  // what was made of the log's
  if (log.points.front().frame >= 0) {
    std::map<int, const MapPosition*> by_frame;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      by_frame[log.points[i].frame] = &samples[i].at;
    }
    for (SceneFrame& frame : scene.frames) {
      const auto at = by_frame.find(frame.id);
      if (at == by_frame.end()) continue;
      frame.map_position = *at->second;
      ++count;
    }
    if (count == 0) {
      throw InputError(options.file.string(),
                       "found no position of one of the frames, expected their numbers");
    }
  } else {
    const double shift = shift_of(log, scene, options.offset);
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [](const GnssSample& s) { return !std::isfinite(s.time_s); }),
                  samples.end());
    if (samples.empty()) {
      throw InputError(options.file.string(), "found positions without times, expected times");
    }
    for (GnssSample& sample : samples) sample.time_s += shift;
    std::stable_sort(samples.begin(), samples.end(),
                     [](const GnssSample& a, const GnssSample& b) { return a.time_s < b.time_s; });
    if (options.offset.empty() && log.leap_seconds != 0.0) {
      const double leap = gps_time_shift(samples, scene, log.leap_seconds, kLongestGap);
      for (GnssSample& sample : samples) sample.time_s += leap;
      clock = leap == 0.0 ? "; its GPS times are taken for the frames' own"
                          : fmt::format("; GPS time, {:.0f} s ahead of the frames' UTC", -leap);
    }
    for (SceneFrame& frame : scene.frames) {
      if (!frame.time_s) continue;
      const auto place = place_in(samples, *frame.time_s, kLongestGap);
      if (!place) continue;
      const auto& [at, share] = *place;
      frame.map_position = between(samples[at].at, samples[share > 0.0 ? at + 1 : at].at, share);
      ++count;
    }
    require_some(count, scene, samples, options.file, "positions",
                 "; --gnss-offset moves the log (first: its start is the first frame)");
  }
  scene.map_crs = crs;
  scene.antenna = options.antenna;
  out.found.push_back(fmt::format(
      "positions of {} of {} frames from {} ({}), on the map of {}{}", count, scene.frames.size(),
      printable(options.file.filename().string(), 64), log.form, crs, clock));
}

}  // namespace camber
