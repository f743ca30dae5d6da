#include "camber/export/crg_strip.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/export/detail/series.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kLookStep = 0.25;  // m across, when looking how far the ground is seen
constexpr double kGap = 1.0;        // m without ground that are passed over
constexpr double kBend = 0.9;       // of the radius, how far in a grid may go
constexpr double kBendStep = 0.1;   // m along, when looking for bends
constexpr std::size_t kMostNodes = 50000000;

Vector2d direction(double heading) { return {std::cos(heading), std::sin(heading)}; }

/// Whole-number multiples of a millimetre, as OpenCRG's checks want increments.
double millimetres(double value) { return std::round(value * 1000.0) / 1000.0; }

double side_seen(const HeightSource& ground, const Vector2d& foot, const Vector2d& left,
                 double level, double sign, double limit) {
  double seen = 0.0, z = level;
  for (double v = 0.0; v <= limit + 1e-9; v += kLookStep) {
    const Vector2d place = foot + sign * v * left;
    const GroundSample sample = ground.at({place.x(), place.y(), z});
    if (std::isfinite(sample.height)) {
      seen = v;
      z = sample.height;
    } else if (v - seen > kGap) {
      break;
    }
  }
  return seen;
}

/// The reference line in steps that a reader repeats: each heading, as the file holds it, leads
/// from where the reader is to where the line is.
void lay_line(const SmoothLine& line, std::size_t sections, CrgData* data) {
  Vector2d at = line.position(0.0);
  data->start_x = at.x();
  data->start_y = at.y();
  double heading = line.heading(0.0);
  data->phi.assign(1, 0.0);
  for (std::size_t i = 1; i < sections; ++i) {
    const Vector2d to = line.position(static_cast<double>(i) * data->increment) - at;
    const double next = std::atan2(to.y(), to.x());
    // Without a jump of a full turn, which other programs would take for a bend.
    heading += std::remainder(next - heading, 2.0 * M_PI);
    data->phi.push_back(crg_rounded(heading, data->encoding));
    at += data->increment * direction(data->phi.back());
  }
  data->start_phi = data->phi[1];
  data->end_phi = data->phi.back();
  // Some readers take an end that is not stated for the origin.
  data->end_x = at.x();
  data->end_y = at.y();
}

/// Elevation and banking of the line at its sections, unknown where the ground is.
void measure_line(const HeightSource& ground, const CrgRoad& road, const SmoothLine& line,
                  int num_threads, std::vector<double>* heights, std::vector<double>* banking) {
  const std::size_t n = road.sections();
  heights->assign(n, kNaN);
  banking->assign(n, kNaN);
  parallel_for(n, num_threads, [&](std::size_t i) {
    const double u = road.first_u() + static_cast<double>(i) * road.increment();
    const double level = line.height(std::min(u, line.length()));
    double w = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (const double v : road.v()) {
      const Vector2d place = road.position(u, v);
      const double z = ground.at({place.x(), place.y(), level}).height;
      if (!std::isfinite(z)) continue;
      w += 1.0, x += v, y += z, xx += v * v, xy += v * z;
    }
    const Vector2d foot = road.position(u, 0.0);
    (*heights)[i] = ground.at({foot.x(), foot.y(), level}).height;
    const double spread = w * xx - x * x;
    if (w >= 3.0 && spread > 0.25 * w * w) (*banking)[i] = (w * xy - x * y) / spread;
  });
  detail::bridge(heights);
  detail::bridge(banking);
}

/// Heights of the ground for a line that has none.
void take_heights(const HeightSource& ground, int num_threads, SmoothLine* line) {
  std::vector<std::vector<double>> levels(static_cast<std::size_t>(line->length()) + 1);
  parallel_for(levels.size(), num_threads, [&](std::size_t i) {
    levels[i] = ground.levels(line->position(static_cast<double>(i)));
  });
  std::vector<double> stations, heights;
  std::size_t most = 0;
  for (const std::vector<double>& here : levels) {
    stations.push_back(static_cast<double>(stations.size()));
    heights.push_back(here.size() == 1 ? here.front() : kNaN);
    most = std::max(most, here.size());
  }
  const bool known = std::any_of(heights.begin(), heights.end(),
                                 [](double height) { return std::isfinite(height); });
  if (!known && most > 1) {
    throw NoAnswerError(
        "the line has no heights (column z), and the ground has several levels all along it");
  }
  detail::bridge(&heights);
  line->set_heights(std::move(stations), std::move(heights));
}

}  // namespace

void CrgGridOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("CrgGridOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(step_u == 0.0 || (step_u >= 0.001 && step_u <= 100.0), "step_u", step_u,
          "0 or 0.001 to 100 m");
  require(step_v == 0.0 || (step_v >= 0.001 && step_v <= 100.0), "step_v", step_v,
          "0 or 0.001 to 100 m");
  require(right >= 0.0 && right <= 1000.0, "right", right, "0 to 1000 m");
  require(left >= 0.0 && left <= 1000.0, "left", left, "0 to 1000 m");
  require(widest > 0.0 && widest <= 1000.0, "widest", widest, "> 0, at most 1000 m");
  require(smoothing >= 0.0 && std::isfinite(smoothing), "smoothing", smoothing, ">= 0 m");
}

double grid_step(double resolution) {
  if (!(resolution > 0.0)) return 0.25;
  for (const double step : {0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5}) {
    if (resolution <= step * 1.05) return step;
  }
  return 1.0;
}

SeenWidth seen_width(const HeightSource& ground, const SmoothLine& line, double step, double widest,
                     int num_threads) {
  SeenWidth out;
  const auto steps = static_cast<std::size_t>(std::ceil(line.length() / step - 1e-9));
  for (std::size_t i = 0; i <= steps; ++i) {
    out.stations.push_back(std::min(static_cast<double>(i) * step, line.length()));
  }
  out.left.assign(out.stations.size(), 0.0);
  out.right = out.left;
  parallel_for(out.stations.size(), num_threads, [&](std::size_t i) {
    const double s = out.stations[i], curvature = line.curvature(s);
    const Vector2d foot = line.position(s), ahead = direction(line.heading(s));
    const Vector2d left(-ahead.y(), ahead.x());
    const auto limit = [&](double inward) {
      return inward > 0.0 ? std::min(widest, kBend / inward) : widest;
    };
    out.left[i] = side_seen(ground, foot, left, line.height(s), 1.0, limit(curvature));
    out.right[i] = side_seen(ground, foot, left, line.height(s), -1.0, limit(-curvature));
  });
  return out;
}

namespace {

/// Gives a line the heights of the ground's level under it.
void lay_on_ground(const HeightSource& ground, SmoothLine* line) {
  const double steps = std::max(1.0, std::ceil(line->length()));
  const double step = line->length() / steps;
  std::vector<Vector3d> places;
  std::vector<double> stations;
  for (double k = 0.0; k <= steps; k += 1.0) {
    const Vector2d place = line->position(k * step);
    places.emplace_back(place.x(), place.y(), line->height(k * step));
    stations.push_back(k * step);
  }
  std::vector<double> levels = ground.levels_along(places);
  if (!levels.empty()) line->set_heights(std::move(stations), std::move(levels));
}

}  // namespace

SmoothLine line_over_ground(const HeightSource& ground, const std::vector<Vector3d>& points,
                            double tolerance, double most, int num_threads) {
  const auto made = [&](double after) {
    SmoothLine line(points, tolerance, 0.0, after);
    if (std::isnan(line.height(0.0))) take_heights(ground, num_threads, &line);
    lay_on_ground(ground, &line);
    return line;
  };
  const SmoothLine line = made(0.0);
  if (!(most > 0.0)) return line;
  const double end = line.length();
  const Vector2d from = line.position(end), ahead = direction(line.heading(end));
  double z = line.height(end), seen = 0.0;
  for (double by = 0.0; by <= most; by += 0.5) {
    const Vector2d place = from + by * ahead;
    const double height = ground.at({place.x(), place.y(), z}).height;
    if (std::isfinite(height)) {
      seen = by;
      z = height;
    } else if (by - seen > kGap) {
      break;
    }
  }
  return made(seen);
}

GroundBeside ground_beside(const HeightSource& ground, const SmoothLine& line, int num_threads) {
  // Of the nearest level over the line; NaN: none is seen; 0: it is near enough.
  std::vector<double> off(static_cast<std::size_t>(line.length()) + 1, 0.0);
  parallel_for(off.size(), num_threads, [&](std::size_t i) {
    const auto s = static_cast<double>(i);
    const Vector2d place = line.position(s);
    if (std::isfinite(ground.at({place.x(), place.y(), line.height(s)}).height)) return;
    off[i] = kNaN;
    for (const double level : ground.levels(place)) {
      const double above = level - line.height(s);
      if (!(std::abs(above) >= std::abs(off[i]))) off[i] = above;
    }
  });
  GroundBeside out;
  std::vector<double> far;
  for (const double above : off) {
    out.stations += std::isfinite(above);
    if (std::abs(above) >= kPointLevelGap) far.push_back(above);
  }
  out.far = far.size();
  if (out.far > 0) out.above = upper_median(&far);
  return out;
}

std::optional<TightBend> tight_bend(const HeightSource& ground, const SmoothLine& line, double left,
                                    double right, double widest) {
  std::vector<TightBend> bends;
  for (double s = 0.0; s <= line.length(); s += kBendStep) {
    TightBend bend;
    bend.station = s;
    bend.left = line.curvature(s) > 0.0;
    bend.radius = 1.0 / std::abs(line.curvature(s));
    bend.room = kBend * bend.radius;
    bend.wanted = bend.left ? left : right;
    if (bend.room < (bend.wanted > 0.0 ? bend.wanted : widest)) bends.push_back(bend);
  }
  std::stable_sort(bends.begin(), bends.end(),
                   [](const TightBend& a, const TightBend& b) { return a.radius < b.radius; });
  for (TightBend& bend : bends) {
    if (!(bend.wanted > 0.0)) {
      const Vector2d ahead = direction(line.heading(bend.station)), aside(-ahead.y(), ahead.x());
      bend.wanted = side_seen(ground, line.position(bend.station), aside, line.height(bend.station),
                              bend.left ? 1.0 : -1.0, widest);
    }
    if (bend.wanted > bend.room + kLookStep) return bend;
  }
  return std::nullopt;
}

CrgData make_crg(const HeightSource& ground, const SmoothLine& line,
                 const CrgGridOptions& options) {
  options.validate();
  CrgData data;
  data.encoding = options.encoding;
  data.increment =
      millimetres(options.step_u > 0.0 ? options.step_u : grid_step(ground.resolution()));
  const double step_v =
      millimetres(options.step_v > 0.0 ? options.step_v : grid_step(ground.resolution()));
  const auto sections = static_cast<std::size_t>(line.length() / data.increment + 1e-6) + 1;
  if (sections < 2) {
    throw NoAnswerError(fmt::format("the line is {:.3g} m long, expected at least one step of {} m",
                                    line.length(), data.increment));
  }
  // Width.
  const SeenWidth width =
      seen_width(ground, line, std::max(1.0, data.increment), options.widest, options.num_threads);
  double right = *std::max_element(width.right.begin(), width.right.end());
  double left = *std::max_element(width.left.begin(), width.left.end());
  if (options.right > 0.0) right = options.right;
  if (options.left > 0.0) left = options.left;
  for (double s = 0.0; s <= line.length(); s += data.increment) {  // no grid folds over itself
    const double curvature = line.curvature(s);
    if (curvature > 0.0) left = std::min(left, kBend / curvature);
    if (curvature < 0.0) right = std::min(right, -kBend / curvature);
  }
  const auto columns_right = static_cast<long>(right / step_v + 1e-6);
  const auto columns_left = static_cast<long>(left / step_v + 1e-6);
  if (columns_right + columns_left < 1) {
    const double beside = std::max(left, right);
    if (options.step_v > 0.0 && beside >= grid_step(ground.resolution())) {
      throw UsageError(
          fmt::format("--step-across: found {:g} m, expected at most {:.2f} m, as far as the road "
                      "reaches beside the line",
                      step_v, std::floor(100.0 * beside) / 100.0));
    }
    const bool bent =
        tight_bend(ground, line, options.left, options.right, options.widest).has_value();
    throw NoAnswerError(bent ? "no road fits beside the line"
                             : "no ground is seen beside the line");
  }
  for (long j = -columns_right; j <= columns_left; ++j) {
    data.v.push_back(millimetres(static_cast<double>(j) * step_v));
  }
  data.v_right = data.v.front();
  data.v_left = data.v.back();
  if (sections > kMostNodes / data.v.size()) {
    throw NoAnswerError(fmt::format("{} x {} heights are too many; larger steps give fewer",
                                    sections, data.v.size()));
  }
  lay_line(line, sections, &data);
  data.modifiers = CrgModifiers();
  data.modifiers->unknown = CrgUnknown::kKeep;
  data.heights.assign(sections * data.v.size(), 0.0f);
  // Elevation and banking as a reader adds them up.
  std::vector<double> heights, banking;
  measure_line(ground, CrgRoad(data), line, options.num_threads, &heights, &banking);
  const auto half = static_cast<std::size_t>(0.5 * options.smoothing / data.increment);
  heights = detail::smoothed(heights, half);
  banking = detail::smoothed(banking, half);
  data.start_z = millimetres(heights.front());
  data.has_start_z = true;
  if (options.slope_in_line) {
    data.slope.assign(1, 0.0);
    double z = data.start_z;
    for (std::size_t i = 1; i < sections; ++i) {
      data.slope.push_back(crg_rounded((heights[i] - z) / data.increment, data.encoding));
      z += data.slope.back() * data.increment;
    }
  }
  if (options.banking_in_line) {
    for (const double b : banking) data.banking.push_back(crg_rounded(b, data.encoding));
  }
  const CrgRoad road(data);
  std::vector<char> seen(sections, 0);
  parallel_for(sections, options.num_threads, [&](std::size_t i) {
    const double u = static_cast<double>(i) * data.increment;
    for (std::size_t j = 0; j < data.v.size(); ++j) {
      const Vector2d place = road.position(u, data.v[j]);
      const double z = ground.at({place.x(), place.y(), heights[i]}).height;
      const double above = z - road.reference_height(i) - road.banking(i) * data.v[j];
      data.heights[i * data.v.size() + j] = static_cast<float>(above);
      if (std::isfinite(z)) seen[i] = 1;
    }
  });
  if (std::count(seen.begin(), seen.end(), 1) == 0) {
    throw NoAnswerError("no ground is seen beside the line");
  }
  return data;
}

}  // namespace camber
