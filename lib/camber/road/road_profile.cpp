#include "camber/road/road_profile.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/road/detail/process_variance.h"
#include "camber/road/plan_polygon.h"
#include "camber/road/surface_lookup.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kLeastCover = 0.6;     // share of the length that must be covered
constexpr double kStraight = 1e-5;      // 1/m, curvatures below it are called straight
constexpr double kLeastSamples = 10.0;  // of the length over which slopes are measured
// m, over which what planes leave out is alike along the road; across it a patch's slope is off by
// what it leaves out over such a length.
constexpr double kUnmodelledLength = 8.0, kUnmodelledAcross = 3.5;

// Cross slope: m to either side within which another patch may be the one that is meant, and the
// share of a change between two planes that is one standard deviation of what lies between.
constexpr double kBeside = 0.3, kOfChange = 0.6;

/// Standard deviation of the slope of a patch (rise over run) in a direction in plan.
double sigma_slope(const UncertainPlane& plane, const Vector3d& up, const Vector3d& direction) {
  // Height along up over a place p in plan: z = -(n . p + d) / (n . up); its slope in the direction
  // e is -(n . e) / (n . up). A tilt t turns n by t x n.
  const Vector3d& n = plane.plane.normal;
  const double slant = n.dot(up);
  Eigen::RowVector2d jacobian;
  const Vector3d axes[2] = {plane.axis1, plane.axis2};
  for (int i = 0; i < 2; ++i) {
    const Vector3d change = axes[i].cross(n);
    jacobian[i] =
        -change.dot(direction) / slant + n.dot(direction) * change.dot(up) / (slant * slant);
  }
  const double variance = jacobian * plane.covariance.topLeftCorner<2, 2>() * jacobian.transpose();
  return std::sqrt(std::max(variance, 0.0));
}

/// A line's corners at different places in plan, with their stations.
struct Corners {
  std::vector<Vector3d> places;
  std::vector<double> stations;

  Corners(const std::vector<Vector3d>& line, const GroundAxes& axes) {
    for (const Vector3d& corner : line) {
      if (!corner.allFinite()) continue;
      const double step = places.empty() ? 0.0 : (axes(corner) - axes(places.back())).norm();
      if (!places.empty() && !(step > 1e-9)) continue;
      stations.push_back(places.empty() ? 0.0 : stations.back() + step);
      places.push_back(corner);
    }
  }
};

/// A place on the line with what the errors of its height are made of.
struct Sample {
  bool station = false;  ///< of the profile; others serve the slopes of their neighbours
  ProfilePoint point;
  Eigen::Vector3d ahead = Eigen::Vector3d::Zero();  ///< unit, level
  UncertainPlane plane;
  Eigen::RowVector3d jacobian = Eigen::RowVector3d::Zero();  ///< d height / d plane parameters
  double unmodelled = 0.0;                                   ///< m
  double middle = 0.0, length = 0.0;  ///< m, of the patch along the line: station, extent
};

/// The variance of the sum of weights times heights of samples [begin, begin + weights.size()).
/// @param levelling  standard deviation of what levelling makes of that sum
double variance_of_sum(const std::vector<Sample>& samples, std::size_t begin,
                       const std::vector<double>& weights, double drift, double levelling) {
  detail::ProcessVariance unmodelled(kUnmodelledLength), drifting(detail::kDriftLength);
  double variance = levelling * levelling;
  // Samples on one patch err together.
  Eigen::RowVector3d jacobian = Eigen::RowVector3d::Zero();
  const Sample* on = nullptr;
  const auto close = [&] {
    if (on) variance += jacobian * on->plane.covariance * jacobian.transpose();
    jacobian.setZero();
  };
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const Sample& sample = samples[begin + i];
    if (sample.point.status == Status::kFailed) continue;
    if (on && on->point.patch != sample.point.patch) close();
    on = &sample;
    jacobian += weights[i] * sample.jacobian;
    unmodelled.add(sample.point.station, weights[i] * sample.unmodelled);
    drifting.add(sample.point.station, weights[i] * drift);
  }
  close();
  return variance + unmodelled.variance() + drifting.variance();
}

}  // namespace

void ProfileOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("ProfileOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(step > 0.0 && std::isfinite(step), "step", step, "> 0 m");
  require(length > 0.0 && std::isfinite(length), "length", length, "> 0 m");
  require(reach >= 0.0, "reach", reach, ">= 0 m");
  require(levelling_sigma >= 0.0 && std::isfinite(levelling_sigma), "levelling_sigma",
          levelling_sigma, ">= 0 rad");
  require(drift_sigma >= 0.0 && std::isfinite(drift_sigma), "drift_sigma", drift_sigma, ">= 0 m");
}

namespace {

/// Samples of a line: the stations, and between them as many as the length over which slopes are
/// measured needs.
struct Sampling {
  std::size_t per_step = 1;
  double spacing = 0.0;      ///< m
  double half_window = 0.0;  ///< m to either side of a station, a multiple of the spacing

  explicit Sampling(const ProfileOptions& options)
      : per_step(static_cast<std::size_t>(
            std::max(1.0, std::ceil(options.step * kLeastSamples / options.length - 1e-9)))),
        spacing(options.step / static_cast<double>(per_step)),
        half_window(std::max(1.0, std::round(0.5 * options.length / spacing)) * spacing) {}

  double samples_of_window() const { return 2.0 * std::round(half_window / spacing) + 1.0; }
};

/// How much the cross slope of the ground beside a place, on another patch than its own, differs
/// from its own: at a crown either may be the one that is meant.
double change_beside(const SurfaceLookup& lookup, const RoadSurface& surface, const Vector3d& place,
                     const Vector3d& left, double reach, const ProfilePoint& own) {
  const GroundAxes axes(surface.up);
  double most = 0.0;
  for (const double side : {-kBeside, kBeside}) {
    const Vector3d there = place + side * left;
    const SurfaceQuery beside = lookup.query_level(there, std::min(reach, kBeside));
    if (beside.status == Status::kFailed || beside.patch == own.patch) continue;
    PlanPolygon outline;
    for (const Vector3d& corner : surface.find(own.patch)->boundary) {
      outline.push_back(axes(corner));
    }
    if (!(distance_to_polygon(outline, axes(there)) > 0.0)) continue;
    const Vector3d& n = beside.plane.plane.normal;
    most =
        std::max(most, std::abs(-n.dot(left) / n.dot(surface.up.normalized()) - own.cross_slope));
  }
  return most;
}

/// What the surface answers at a sample, which lies at a place of the ground's level.
void ask(const SurfaceLookup& lookup, const RoadSurface& surface, const Vector3d& place,
         const ProfileOptions& options, Sample* sample) {
  const Vector3d up = surface.up.normalized(), left = up.cross(sample->ahead);
  ProfilePoint& point = sample->point;
  const SurfaceQuery answer = lookup.query_level(place, options.reach);
  point.status = answer.status;
  point.reason = answer.reason;
  if (answer.status == Status::kFailed) return;
  const Vector3d& n = answer.plane.plane.normal;
  const double slant = n.dot(up);
  point.patch = answer.patch;
  point.point = answer.point;
  point.height = answer.point.dot(up);
  point.cross_slope = -n.dot(left) / slant;
  sample->plane = answer.plane;
  sample->jacobian = answer.plane.height_jacobian(answer.point) / slant;
  sample->unmodelled = surface.find(answer.patch)->unmodelled_sigma / slant;
  point.sigma_height = answer.sigma_height / slant;
  point.sigma_cross_slope =
      std::hypot(sigma_slope(answer.plane, up, left), sample->unmodelled / kUnmodelledAcross,
                 options.levelling_sigma);
  point.sigma_cross_slope =
      std::hypot(point.sigma_cross_slope,
                 kOfChange * change_beside(lookup, surface, place, left, options.reach, point));
}

/// The samples of a line with what is known at each by itself.
std::vector<Sample> find_samples(const RoadSurface& surface, const std::vector<Vector3d>& line,
                                 const ProfileOptions& options, const Sampling& sampling) {
  const Vector3d up = surface.up.normalized();
  const GroundAxes axes(up);
  const Corners corners(line, axes);
  if (corners.places.size() < 2) {
    throw std::invalid_argument(
        fmt::format("road_profile: the line has {} different places, expected at least 2",
                    corners.places.size()));
  }
  const double total = corners.stations.back();
  constexpr double kMost = 1e6;
  const auto require = [total](const char* field, double value, double least) {
    if (value > least) return;
    throw std::invalid_argument(
        fmt::format("{}: found {:g} m, expected more than {:g} m for a line of {:g} m", field,
                    value, least, total));
  };
  require("step", options.step, total / kMost);
  if (!(total / sampling.spacing < kMost)) {
    require("length", options.length, kLeastSamples * total / kMost);
  }
  std::vector<Sample> samples;
  std::size_t piece = 0;
  const auto steps = static_cast<std::size_t>(std::floor(total / options.step + 1e-9));
  const auto add = [&](double at, bool is_station) {
    while (piece + 2 < corners.stations.size() && at > corners.stations[piece + 1]) ++piece;
    const Vector3d &from = corners.places[piece], &to = corners.places[piece + 1];
    const double share =
        (at - corners.stations[piece]) / (corners.stations[piece + 1] - corners.stations[piece]);
    const Vector3d place = from + share * (to - from);
    const Vector2d flat = (axes(to) - axes(from)).normalized();
    Sample sample;
    sample.station = is_station;
    sample.ahead = flat.x() * axes.e1 + flat.y() * axes.e2;
    sample.point.station = at;
    sample.point.point = place;
    samples.push_back(std::move(sample));
  };
  for (std::size_t k = 0; k <= steps; ++k) {
    const double at = static_cast<double>(k) * options.step;
    add(std::min(at, total), true);
    for (std::size_t j = 1; j < sampling.per_step; ++j) {
      const double on = static_cast<double>(j) * sampling.spacing;
      if (at + on <= total) add(at + on, false);
    }
  }
  std::vector<Vector3d> places;
  places.reserve(samples.size());
  for (const Sample& sample : samples) places.push_back(sample.point.point);
  const SurfaceLookup lookup(surface);
  const LineOverGround over = lookup.follow(places, options.reach);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    ask(lookup, surface, places[k] - over.above[k] * up, options, &samples[k]);
  }
  return samples;
}

/// Where each sample's patch lies along the line.
void place_patches(const RoadSurface& surface, std::vector<Sample>* samples) {
  const auto patch = [&](std::size_t k) { return (*samples)[k].point.patch; };
  for (std::size_t begin = 0, end = 0; begin < samples->size(); begin = end) {
    while (end < samples->size() && patch(end) == patch(begin)) ++end;
    const PlanePatch* const on = surface.find(patch(begin));
    if (!on) continue;
    const Sample& at = (*samples)[begin + (end - begin) / 2];
    const auto along = [&](const Vector3d& x) { return at.ahead.dot(x - at.point.point); };
    double first = 0.0, last = 0.0;
    for (const Vector3d& corner : on->boundary) {
      first = std::min(first, along(corner));
      last = std::max(last, along(corner));
    }
    for (std::size_t k = begin; k < end; ++k) {
      (*samples)[k].middle = at.point.station + along(on->plane.centroid);
      (*samples)[k].length = last - first;
    }
  }
}

/// Samples on one patch in a row.
struct PatchRun {
  std::size_t begin = 0, end = 0;
  int patch = -1;
  double middle = 0.0;                       ///< m, station of the patch's middle
  double cross_slope = 0.0, variance = 0.0;  ///< there
};

std::vector<PatchRun> patch_runs(const std::vector<Sample>& samples) {
  std::vector<PatchRun> runs;
  for (std::size_t begin = 0, end = 0; begin < samples.size(); begin = end) {
    const int patch = samples[begin].point.patch;
    while (end < samples.size() && samples[end].point.patch == patch) ++end;
    if (patch < 0) continue;
    PatchRun run;
    run.begin = begin;
    run.end = end;
    run.patch = patch;
    run.middle = samples[begin].middle;
    std::size_t nearest = begin;
    for (std::size_t k = begin; k < end; ++k) {
      const auto off = [&](std::size_t j) {
        return std::abs(samples[j].point.station - run.middle);
      };
      if (off(k) < off(nearest)) nearest = k;
    }
    run.cross_slope = samples[nearest].point.cross_slope;
    run.variance = std::pow(samples[nearest].point.sigma_cross_slope, 2);
    runs.push_back(run);
  }
  return runs;
}

/// Superelevation that runs off twists a road, and planes show its cross slope in their middles
/// alone: away from there what lies between it and the next plane's is part of the deviation, as
/// far as their own do not explain it.
void widen_by_twist(std::vector<Sample>* samples) {
  constexpr double kFarthest = 15.0, kNearest = 2.0;  // m between runs; between middles
  const std::vector<PatchRun> runs = patch_runs(*samples);
  const auto joins = [&](std::size_t a, std::size_t b) {
    return (*samples)[runs[b].begin].point.station - (*samples)[runs[a].end - 1].point.station <=
               kFarthest &&
           runs[a].patch != runs[b].patch && runs[b].middle - runs[a].middle >= kNearest;
  };
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const PatchRun& run = runs[r];
    const PatchRun* const before = r > 0 && joins(r - 1, r) ? &runs[r - 1] : nullptr;
    const PatchRun* const after = r + 1 < runs.size() && joins(r, r + 1) ? &runs[r + 1] : nullptr;
    for (std::size_t k = run.begin; k < run.end; ++k) {
      ProfilePoint& point = (*samples)[k].point;
      const double off = std::abs(point.station - run.middle);
      double twist = std::abs(run.cross_slope - point.cross_slope), more = twist * twist;
      for (const PatchRun* const next : {before, after}) {
        if (!next) continue;
        // The twist may go on as on the other side.
        const double share = std::min(1.0, off / std::abs(next->middle - run.middle));
        twist = share * (next->cross_slope - run.cross_slope);
        const double by_chance = share * share * (next->variance + run.variance);
        more = std::max(more, twist * twist - by_chance);
      }
      point.sigma_cross_slope = std::hypot(point.sigma_cross_slope, kOfChange * std::sqrt(more));
    }
  }
}

/// The parabola through the heights around a sample, relative to its own.
struct HeightParabola {
  bool found = false;
  std::size_t begin = 0;              ///< first sample
  double count = 0.0;                 ///< heights
  Vector3d value = Vector3d::Zero();  ///< height, slope, second derivative
  /// Rows that give slope and second derivative, of (1, s, s^2 / 2).
  Vector3d to_slope = Vector3d::Zero(), to_second = Vector3d::Zero();
  std::vector<Vector3d> rows;  ///< zero where there is no height
  /// The second derivative that planes fitted to a road of second derivative 1 would show.
  double response = 0.0;
  /// What the planes may hide of it, one standard deviation. Over a length L a plane is off a road
  /// of second derivative b by b L^2 / 12 sqrt(5), root mean square.
  double hidden = 0.0;
};

/// @param stride  samples taken, one of so many
HeightParabola fit_parabola(const std::vector<Sample>& samples, std::size_t k, double half_window,
                            std::size_t stride) {
  HeightParabola out;
  const ProfilePoint& here = samples[k].point;
  const double reach = half_window * (1.0 + 1e-6);
  const auto near = [&](std::size_t j) {
    return std::abs(samples[j].point.station - here.station) <= reach;
  };
  std::size_t end = k;
  out.begin = k;
  while (out.begin >= stride && near(out.begin - stride)) out.begin -= stride;
  while (end + stride < samples.size() && near(end + stride)) end += stride;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (std::size_t j = out.begin; j <= end; j += stride) {
    const ProfilePoint& point = samples[j].point;
    const double s = point.station - here.station;
    out.rows.emplace_back(1.0, s, 0.5 * s * s);
    if (point.status == Status::kFailed) {
      out.rows.back().setZero();
      continue;
    }
    normal += out.rows.back() * out.rows.back().transpose();
    right += (point.height - here.height) * out.rows.back();
    out.count += 1.0;
  }
  if (out.count < 3.0) return out;
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(normal);
  out.value = lu.solve(right);
  out.found = out.value.allFinite();
  out.to_slope = lu.solve(Vector3d::UnitY());  // normal is symmetric
  out.to_second = lu.solve(Vector3d::UnitZ());
  for (std::size_t i = 0; i < out.rows.size(); ++i) {
    const Sample& sample = samples[out.begin + i * stride];
    if (sample.point.status == Status::kFailed || !(sample.length > 0.0)) continue;
    const double middle = sample.middle - here.station, squared = sample.length * sample.length;
    const double line = 0.5 * (middle * middle + squared / 12.0) +
                        middle * (out.rows[i][1] - middle);  // least squares of s^2 / 2
    const double weight = out.to_second.dot(out.rows[i]);
    out.response += weight * line;
    out.hidden +=
        weight * (out.rows[i][2] - line) * sample.unmodelled * 12.0 * std::sqrt(5.0) / squared;
  }
  return out;
}

/// What the bend of the planes in a window lacks of the road's, or is too large by, as far as what
/// the planes leave out allows. Planes bend where they meet alone; over a window that is wide
/// enough they show the second derivative of a road that bends evenly.
double hidden_bend(const std::vector<Sample>& samples, std::size_t k, const Sampling& sampling,
                   const HeightParabola& parabola) {
  constexpr double kWidest = 8.0, kWider = 1.25;  // of the window
  constexpr double kShown = 0.6, kLeastShown = 0.3, kMostSigmas = 1.5;
  const double lacking = 1.0 - parabola.response;
  if (!(std::abs(parabola.hidden) > 0.0) || !(std::abs(lacking) > 1e-9)) return 0.0;
  const auto stride = static_cast<std::size_t>(std::max(
      1.0, std::floor(2.0 * sampling.half_window / (kLeastSamples * sampling.spacing) + 1e-9)));
  HeightParabola wide = parabola;
  for (double by = kWider; wide.response < kShown && by <= kWidest; by *= kWider) {
    wide = fit_parabola(samples, k, by * sampling.half_window, stride);
  }
  if (!wide.found || !(wide.response > kLeastShown)) return 0.0;
  const double most = kMostSigmas * std::abs(parabola.hidden / lacking);
  return lacking * std::clamp(wide.value[2] / wide.response, -most, most);
}

/// Grade, vertical curvature and their standard deviations at sample k, from the heights around it.
void measure_grade(std::size_t k, const Sampling& sampling, double drift, double levelling,
                   std::vector<Sample>* samples) {
  ProfilePoint& here = (*samples)[k].point;
  const HeightParabola parabola = fit_parabola(*samples, k, sampling.half_window, 1);
  if (!parabola.found || parabola.count < kLeastCover * sampling.samples_of_window()) return;
  // A straight line for the grade where the window is symmetric; at its ends the parabola's slope
  // at the station, for the line's would be that of another station.
  here.grade = parabola.value[1];
  const double grade2 = 1.0 + here.grade * here.grade;
  const double bend = 1.0 / (grade2 * std::sqrt(grade2));  // curvature by second derivative
  here.vertical_curvature =
      bend * (parabola.value[2] + hidden_bend(*samples, k, sampling, parabola));
  here.vertical_radius = std::abs(here.vertical_curvature) > kStraight
                             ? 1.0 / here.vertical_curvature
                             : std::numeric_limits<double>::infinity();
  const double by_grade = -3.0 * here.grade / grade2 * here.vertical_curvature;
  const auto variance = [&](const Vector3d& to_value, double levelled) {
    std::vector<double> weights;
    for (const Vector3d& row : parabola.rows) weights.push_back(to_value.dot(row));
    return variance_of_sum(*samples, parabola.begin, weights, drift, levelled);
  };
  here.sigma_grade = std::sqrt(variance(parabola.to_slope, levelling));
  const double of_heights =
      variance(bend * parabola.to_second + by_grade * parabola.to_slope, by_grade * levelling);
  here.sigma_vertical_curvature = std::hypot(std::sqrt(of_heights), bend * parabola.hidden);
}

}  // namespace

std::vector<ProfilePoint> road_profile(const RoadSurface& surface,
                                       const std::vector<Vector3d>& line,
                                       const ProfileOptions& options) {
  options.validate();
  const Sampling sampling(options);
  std::vector<Sample> samples = find_samples(surface, line, options, sampling);
  place_patches(surface, &samples);
  widen_by_twist(&samples);
  const double drift = surface.metric ? options.drift_sigma : 0.0;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    if (!samples[k].station || samples[k].point.status == Status::kFailed) continue;
    measure_grade(k, sampling, drift, options.levelling_sigma, &samples);
  }
  std::vector<ProfilePoint> profile;
  for (Sample& sample : samples) {
    if (sample.station) profile.push_back(std::move(sample.point));
  }
  const double middle = 0.5 * profile.back().station;
  for (ProfilePoint& point : profile) {
    // The cloud may be turned about the middle of the line, as far as stations go.
    point.sigma_height =
        std::hypot(point.sigma_height, drift, options.levelling_sigma * (point.station - middle));
  }
  return profile;
}

}  // namespace camber
