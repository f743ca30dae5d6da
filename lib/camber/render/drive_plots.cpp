#include "camber/render/drive_plots.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kBandSigmas = 1.96;  // on either side of a 95 % band
constexpr Color kStripGrey{170, 170, 170, 1.0};

/// m, standard deviation of a frame's place along up.
double height_sigma(const DriveFrame& frame, const Eigen::Vector3d& up) {
  if (!frame.world_from_camera || !frame.covariance) return kNaN;
  const Eigen::Vector3d in_camera = frame.world_from_camera->rotation().conjugate() * up;
  const Eigen::Matrix3d covariance = frame.covariance->bottomRightCorner<3, 3>();
  return std::sqrt(std::max(0.0, in_camera.dot(covariance * in_camera)));
}

/// A curve with its band, of one value a place.
class Curve {
 public:
  explicit Curve(const Color& color) {
    band_.kind = PlotSeries::Kind::kBand;
    band_.name = "95 % band";
    band_.color = color.with_alpha(0.25);
    line_.name = "estimate";
    line_.color = color;
  }
  void add(double x, double value, double sigma) {
    line_.x.push_back(x);
    line_.y.push_back(value);
    band_.x.push_back(x);
    band_.low.push_back(value - kBandSigmas * sigma);
    band_.high.push_back(value + kBandSigmas * sigma);
  }
  bool known() const {
    return std::any_of(line_.y.begin(), line_.y.end(), [](double v) { return std::isfinite(v); });
  }
  std::vector<PlotSeries> series() const { return {band_, line_}; }

 private:
  PlotSeries band_, line_;
};

Plot panel(const std::string& title, const std::string& unit, const std::string& along,
           const Curve& curve) {
  Plot out;
  out.title = title;
  out.y.title = unit;
  out.x.title = along;
  out.series = curve.series();
  return out;
}

std::string along_title(bool metric) {
  return metric ? "along the driven line (m)" : "along the driven line (units)";
}

/// The profile's value at a length of the line, of the nearest station.
double nearest(const std::vector<ProfilePoint>& profile, double s, double ProfilePoint::*value) {
  const auto after =
      std::lower_bound(profile.begin(), profile.end(), s,
                       [](const ProfilePoint& point, double at) { return point.station < at; });
  if (profile.empty()) return kNaN;
  if (after == profile.end()) return profile.back().*value;
  if (after == profile.begin()) return (*after).*value;
  const auto before = after - 1;
  return s - before->station < after->station - s ? (*before).*value : (*after).*value;
}

struct Bounds {
  double x1 = 1e30, y1 = 1e30, x2 = -1e30, y2 = -1e30;
  void add(const Eigen::Vector3d& p) {
    x1 = std::min(x1, p.x());
    x2 = std::max(x2, p.x());
    y1 = std::min(y1, p.y());
    y2 = std::max(y2, p.y());
  }
};

/// The strip from above as a picture of `bounds`.
Image strip_picture(const RoadStrip& strip, const std::vector<ProfilePoint>& profile,
                    const std::pair<double, double>& range, const Bounds& bounds) {
  constexpr double kMostPixels = 1400.0, kFinest = 0.25;  // pixels a side; m a pixel
  const double extent = std::max(bounds.x2 - bounds.x1, bounds.y2 - bounds.y1);
  const double pixel = std::max(kFinest, extent / kMostPixels);
  const int width = std::max(1, static_cast<int>(std::ceil((bounds.x2 - bounds.x1) / pixel)));
  const int height = std::max(1, static_cast<int>(std::ceil((bounds.y2 - bounds.y1) / pixel)));
  Image out = make_picture(width, height, 255);
  const int reach = std::max(1, static_cast<int>(std::ceil(0.25 / pixel)));
  for (const StripCell& cell : strip.cells) {
    const double grade = nearest(profile, cell.s, &ProfilePoint::grade);
    const Color c = std::isfinite(grade)
                        ? viridis((grade - range.first) / (range.second - range.first))
                        : kStripGrey;
    const int x = static_cast<int>((cell.point.x() - bounds.x1) / pixel);
    const int y = height - 1 - static_cast<int>((cell.point.y() - bounds.y1) / pixel);
    for (int row = std::max(0, y - reach); row <= std::min(height - 1, y + reach); ++row) {
      for (int column = std::max(0, x - reach); column <= std::min(width - 1, x + reach);
           ++column) {
        std::uint8_t* at = out.data.data() + 3 * (static_cast<std::size_t>(row) * width + column);
        at[0] = c.red;
        at[1] = c.green;
        at[2] = c.blue;
      }
    }
  }
  return out;
}

/// Entries of the legend for the scale of colours.
void add_scale(const std::pair<double, double>& range, Plot* plot) {
  constexpr int kEntries = 5;
  for (int i = 0; i < kEntries; ++i) {
    const double share = static_cast<double>(i) / (kEntries - 1);
    PlotSeries entry;
    entry.kind = PlotSeries::Kind::kBoxes;
    entry.color = viridis(share);
    entry.name = format_number(100.0 * (range.first + share * (range.second - range.first)), 1) +
                 (i == 0 ? " % grade" : " %");
    plot->series.push_back(entry);
  }
  PlotSeries unknown;
  unknown.kind = PlotSeries::Kind::kBoxes;
  unknown.color = kStripGrey;
  unknown.name = "not driven over";
  plot->series.push_back(unknown);
}

/// @param beside  m to the right of the line.
void add_lengths(const DrivenLine& line, double beside, bool metric, Plot* plot) {
  const Ticks ticks = make_ticks(0.0, line.length(), 8);
  for (std::size_t i = 0; i < ticks.values.size(); ++i) {
    Eigen::Vector2d ahead;
    Eigen::Vector3d at = line.at(ticks.values[i], &ahead);
    at.head<2>() += beside * Eigen::Vector2d(ahead.y(), -ahead.x());  // right of the strip
    plot->notes.push_back(
        {at.x(), at.y(), ticks.labels[i] + (metric ? " m" : ""), TextAnchor::kCenter});
  }
}

void add_tracks(const DriveContent& content, Plot* plot) {
  PlotSeries parked;
  parked.kind = PlotSeries::Kind::kPoints;
  parked.name = "parked vehicle";
  parked.color = {204, 121, 167, 1.0};
  parked.marker = 1;
  parked.marker_size = 0.5;
  bool moving = false;
  for (const DriveTrackLine& track : content.tracks) {
    if (track.places.empty()) continue;
    if (track.parked) {
      const Eigen::Vector3d p = content.strip->strip_from_world * track.places.front().in_world;
      parked.x.push_back(p.x());
      parked.y.push_back(p.y());
      continue;
    }
    PlotSeries line;
    if (!moving) line.name = "moving vehicle";
    moving = true;
    line.color = {230, 120, 0, 0.8};
    line.thickness = 1.5;
    for (const DriveTrackLine::Place& place : track.places) {
      const Eigen::Vector3d p = content.strip->strip_from_world * place.in_world;
      line.x.push_back(p.x());
      line.y.push_back(p.y());
    }
    plot->series.push_back(line);
  }
  if (!parked.x.empty()) plot->series.push_back(parked);
}

}  // namespace

std::vector<double> frame_stations(const DriveContent& content) {
  // The line's lengths are of the frames that have a pose, in their order.
  const std::vector<double>& lengths = content.strip->line.lengths();
  std::vector<double> out(content.drive->frames.size(), kNaN);
  std::size_t k = 0;
  for (std::size_t i = 0; i < out.size() && k < lengths.size(); ++i) {
    if (content.drive->frames[i].world_from_camera) out[i] = lengths[k++];
  }
  return out;
}

std::vector<ProfilePoint> drive_profile(const DriveContent& content) {
  constexpr double kMostStations = 400.0;
  const RoadSurface& surface = *content.surface;
  ProfileOptions options;
  const double length = content.strip->line.length();
  if (!(length > 0.0)) return {};
  options.step = std::max(surface.metric ? 1.0 : length / 100.0, length / kMostStations);
  if (!surface.metric) options.length = std::max(options.step, length / 20.0);
  if (surface.level_sigma > 0.0) options.levelling_sigma = surface.level_sigma;
  std::vector<ProfilePoint> out;
  try {
    out = road_profile(surface, surface.driven_line, options);
  } catch (const std::invalid_argument&) {
    return {};  // a line without two places in plan
  }
  const std::vector<double> stations = frame_stations(content);
  double start = kNaN;
  std::size_t k = 0;
  for (ProfilePoint& point : out) {
    while (k + 1 < stations.size() && !(stations[k] >= point.station)) ++k;
    if (!std::isfinite(start)) start = point.height;
    point.height -= start;
    const double of_pose =
        k < stations.size() ? height_sigma(content.drive->frames[k], surface.up) : kNaN;
    if (std::isfinite(of_pose)) point.sigma_height = std::hypot(point.sigma_height, of_pose);
  }
  return out;
}

std::pair<double, double> grade_range(const std::vector<ProfilePoint>& profile) {
  std::pair<double, double> out{1e30, -1e30};
  for (const ProfilePoint& point : profile) {
    if (!std::isfinite(point.grade)) continue;
    out.first = std::min(out.first, point.grade);
    out.second = std::max(out.second, point.grade);
  }
  if (!(out.first <= out.second)) return {-0.01, 0.01};
  const double least = 0.06, span = out.second - out.first;
  if (span < least) {
    out.first -= 0.5 * (least - span);
    out.second += 0.5 * (least - span);
  }
  return out;
}

PlotSheet drive_map(const DriveContent& content, const std::vector<ProfilePoint>& profile) {
  const bool metric = content.drive->metric;
  Plot plot;
  plot.equal_scale = true;
  plot.x.title = metric ? "ahead of the start (m)" : "ahead of the start (units)";
  plot.y.title = metric ? "to its left (m)" : "to its left (units)";
  Bounds bounds;
  PlotSeries line;
  line.name = "driven line";
  line.color = {20, 20, 20, 1.0};
  for (const DrivenPoint& p : content.strip->line.points()) {
    bounds.add(p.foot);
    line.x.push_back(p.foot.x());
    line.y.push_back(p.foot.y());
  }
  if (line.x.empty()) throw NoAnswerError("the drive has no line: no frame has a pose");
  for (const StripCell& cell : content.strip->cells) bounds.add(cell.point);
  double beside = 0.04 * std::max(bounds.x2 - bounds.x1, bounds.y2 - bounds.y1);
  for (const StripCell& cell : content.strip->cells) beside = std::max(beside, 2.0 - cell.lateral);
  add_lengths(content.strip->line, beside, metric, &plot);
  for (const PlotNote& note : plot.notes) bounds.add({note.x, note.y, 0.0});
  bounds.add({bounds.x1 - 0.5, bounds.y1 - 0.5, 0.0});
  bounds.add({bounds.x2 + 0.5, bounds.y2 + 0.5, 0.0});
  if (!content.strip->cells.empty()) {
    const auto range = grade_range(profile);
    PlotSeries picture;
    picture.kind = PlotSeries::Kind::kImage;
    picture.image = strip_picture(*content.strip, profile, range, bounds);
    picture.x = {bounds.x1, bounds.x2};
    picture.y = {bounds.y1, bounds.y2};
    plot.series.push_back(std::move(picture));
    add_scale(range, &plot);
  }
  add_tracks(content, &plot);
  plot.series.push_back(line);
  return {"", {plot}};
}

int map_height(const PlotSheet& map, int width) {
  Bounds bounds;
  for (const PlotSeries& series : map.panels.front().series) {
    for (std::size_t i = 0; i < std::min(series.x.size(), series.y.size()); ++i) {
      bounds.add({series.x[i], series.y[i], 0.0});
    }
  }
  const double ratio = (bounds.y2 - bounds.y1) / std::max(bounds.x2 - bounds.x1, 1e-9);
  return std::clamp(static_cast<int>(0.92 * width * ratio) + width / 8, width / 5, width);
}

PlotSheet drive_profile_plots(const DriveContent& content,
                              const std::vector<ProfilePoint>& profile) {
  const bool metric = content.drive->metric;
  const std::string along = along_title(metric), unit = metric ? "m" : "units";
  Curve height(plot_color(0)), grade(plot_color(2)), bank(plot_color(3)), speed(plot_color(1));
  for (const ProfilePoint& p : profile) {
    height.add(p.station, p.height, p.sigma_height);
    grade.add(p.station, 100.0 * p.grade, 100.0 * p.sigma_grade);
    bank.add(p.station, 100.0 * p.cross_slope, 100.0 * p.sigma_cross_slope);
  }
  const std::vector<double> stations = frame_stations(content);
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const DriveFrame& frame = content.drive->frames[i];
    if (std::isfinite(stations[i])) speed.add(stations[i], frame.speed.value, frame.speed.sigma);
  }
  PlotSheet out;
  if (height.known()) {
    out.panels.push_back(panel("Height above the start", unit, along, height));
  }
  if (grade.known()) out.panels.push_back(panel("Grade", "%", along, grade));
  if (bank.known()) {
    out.panels.push_back(panel("Cross slope (positive: left side up)", "%", along, bank));
  }
  if (speed.known()) {
    out.panels.push_back(panel("Speed", metric ? "m/s" : "units/s", along, speed));
  }
  if (out.panels.empty()) throw NoAnswerError("nothing is known along the driven line");
  return out;
}

PlotSheet drive_film_plots(const std::vector<ProfilePoint>& profile, bool metric) {
  const std::string unit = metric ? "m" : "units";
  Curve height(plot_color(0)), grade(plot_color(2));
  for (const ProfilePoint& p : profile) {
    height.add(p.station, p.height, p.sigma_height);
    grade.add(p.station, 100.0 * p.grade, 100.0 * p.sigma_grade);
  }
  PlotSheet out;
  for (const auto& [title, curve] :
       {std::pair("height (" + unit + ") along the line (" + unit + ")", &height),
        std::pair(std::string("grade (%)"), &grade)}) {
    if (!curve->known()) continue;
    Plot plot;
    plot.title = title;
    plot.series = curve->series();
    for (PlotSeries& series : plot.series) series.name.clear();
    out.panels.push_back(std::move(plot));
  }
  if (out.panels.empty()) throw NoAnswerError("nothing is known along the driven line");
  return out;
}

}  // namespace camber
