#include "camber/scale/ego_plane.h"

#include "camber/scale/detail/driven_profile.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kMostAgree = 0.5;  // share of the points from which on no other start is tried

/// The road ahead in the travel frame: (right, ahead, up), unit of the points.
struct RoadAhead {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> distances;  ///< ahead, ascending, of those that may be the near road
  double nearest() const { return distances[distances.size() / 50]; }
};

template <typename MayBeNear>
RoadAhead road_ahead(const RoadPoints& road, const detail::TravelFrame& frame,
                     const MayBeNear& may_be_near) {
  RoadAhead out;
  out.points.reserve(road.points.size());
  for (const Eigen::Vector3d& p : road.points) {
    out.points.push_back(frame.of(p));
    if (may_be_near(out.points.back())) out.distances.push_back(out.points.back().y());
  }
  std::sort(out.distances.begin(), out.distances.end());
  return out;
}

/// Heights of the near road: of the foot, along the travelled line and across it.
struct NearShape {
  double (*along)(double ahead);   ///< by which the second coefficient grows
  double (*spread)(double ahead);  ///< of a height, relative to other points
  double cross_slope_information;  ///< prior of a level road, over that of one height
  double least_information;        ///< of any coefficient, likewise
};

constexpr NearShape kPlane = {[](double ahead) { return ahead; }, [](double) { return 1.0; }, 0.0,
                              1e-9};
/// Leaves the foot along the direction of travel; noise of 0.03 over a cross slope of 0.1 rad.
constexpr NearShape kParabola = {[](double ahead) { return 0.5 * ahead * ahead; },
                                 [](double ahead) { return ahead; }, 0.3 * 0.3, 0.0};

/// Coefficients of a shape through points, travel frame, by weights after Geman and McClure.
/// @param noise  of a height over its spread, of each round; infinite: all count alike.
Eigen::Vector3d robust_fit(const std::vector<Eigen::Vector3d>& points, const NearShape& shape,
                           const std::vector<double>& noise) {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  for (const double n : noise) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * shape.least_information;
    normal(2, 2) += shape.cross_slope_information;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : points) {
      const Eigen::Vector3d row(1.0, shape.along(p.y()), p.x());
      const double spread = shape.spread(p.y()), r = (p.z() - x.dot(row)) / spread;
      const double weight = 1.0 / (spread * spread * std::pow(1.0 + r * r / (n * n), 2));
      normal += weight * row * row.transpose();
      right += weight * row * p.z();
    }
    x = normal.ldlt().solve(right);
  }
  return x;
}

/// The nearest road that is seen, unit of the points.
struct NearRoad {
  double plane_height = 0.0;  ///< of the camera above the plane through it
  double begins = 0.0;        ///< ahead of the camera
};

void turn_to_cross_slope(double slope, detail::TravelFrame* frame) {
  frame->up = (frame->up - slope * frame->right).normalized();
  frame->right = frame->forward.cross(frame->up);
}

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr const char* kNotBelow = "the nearest points do not lie below the camera";

/// Turns the frame about the direction of travel to the cross slope of the nearest road, whose
/// height below the camera gives a first scale: near points lie about one camera height below the
/// travelled line. @return why there is none; empty: there is one.
std::string fit_near_plane(const RoadPoints& road, double camera_height, detail::TravelFrame* frame,
                           NearRoad* out) {
  const auto below_and_ahead = [](const Eigen::Vector3d& p) {
    return p.y() > 0 && p.z() < 0 && std::abs(p.x()) < p.y();
  };
  RoadAhead ahead = road_ahead(road, *frame, below_and_ahead);
  if (ahead.distances.size() < 30) return "too few road points ahead of and below the camera";
  const double nearest = ahead.nearest();
  std::vector<double> below;
  for (const Eigen::Vector3d& p : ahead.points) {
    if (below_and_ahead(p) && p.y() <= ahead.distances[ahead.distances.size() / 4]) {
      below.push_back(-p.z());
    }
  }
  std::nth_element(below.begin(), below.begin() + static_cast<std::ptrdiff_t>(below.size() / 2),
                   below.end());
  double height = below[below.size() / 2];
  for (int round = 0; round < 4; ++round) {
    const double window = std::max(1.3 * nearest, nearest + 6.0 / camera_height * height);
    std::vector<Eigen::Vector3d> near;
    for (const Eigen::Vector3d& p : ahead.points) {
      if (p.y() > 0 && p.y() < window && std::abs(p.x()) < 0.6 * p.y() &&
          std::abs(p.z() + height) < 0.5 * height) {
        near.push_back(p);
      }
    }
    if (near.size() < 20) return "too few road points near the camera";
    const double noise = (round == 0 ? 0.1 : 0.03) * height;
    const Eigen::Vector3d x =
        robust_fit(near, kPlane, {kInfinite, noise, noise, noise, noise, noise});
    if (!(x[0] < 0)) return kNotBelow;
    height = -x[0] / std::sqrt(1.0 + x[1] * x[1] + x[2] * x[2]);
    turn_to_cross_slope(x[2], frame);
    for (std::size_t i = 0; i < ahead.points.size(); ++i) {
      ahead.points[i] = frame->of(road.points[i]);
    }
  }
  *out = {height, nearest};
  return "";
}

/// The same by a parabola, for roads that rise ahead so soon that a plane through what is seen of
/// them does not pass below the camera.
std::string fit_near_parabola(const RoadPoints& road, double /*camera_height*/,
                              detail::TravelFrame* frame, NearRoad* out) {
  constexpr double kWindow = 4.0;      // of the distance to the nearest road
  constexpr std::size_t kFewest = 30;  // points
  // Shares of a point's distance.
  const std::vector<double> noise = {kInfinite, 0.1, 0.1, 0.1, 0.1, 0.03, 0.03, 0.03};
  const RoadAhead ahead =
      road_ahead(road, *frame, [](const Eigen::Vector3d& p) { return p.y() > 0; });
  if (ahead.distances.size() < kFewest) return "too few road points ahead of the camera";
  std::vector<Eigen::Vector3d> near;
  for (const Eigen::Vector3d& p : ahead.points) {
    const bool is_near = p.y() > 0 && p.y() < kWindow * ahead.nearest();
    if (is_near && std::abs(p.x()) < 0.6 * p.y()) near.push_back(p);
  }
  if (near.size() < kFewest) return "too few road points near the camera";
  const Eigen::Vector3d x = robust_fit(near, kParabola, noise);
  if (!(x[0] < 0)) return kNotBelow;
  turn_to_cross_slope(x[2], frame);
  *out = {-x[0] / std::hypot(1.0, x[2]), ahead.nearest()};
  return "";
}

/// A position of the camera on its path.
struct CameraPosition {
  Eigen::Vector3d place;  ///< travel frame
  PlaceOnPath in_plan;
};

/// The camera's other positions, ahead and behind as far as roads bend evenly.
std::vector<CameraPosition> usable_path(const RoadPoints& road, const detail::TravelFrame& frame,
                                        double metres_per_baseline) {
  constexpr double kShortest = 0.02, kLongest = 10.0;  // m, to either side
  std::vector<CameraPosition> out;
  for (std::size_t k = 0; k < road.camera_path.size(); ++k) {
    const Eigen::Vector3d q = frame.of(road.camera_path[k]);
    const double distance = metres_per_baseline * std::abs(q.y());
    if (distance > kShortest && distance < kLongest && q.norm() < 1.2 * std::abs(q.y())) {
      out.push_back({q, {metres_per_baseline * q.y(), metres_per_baseline * q.x(), std::nullopt}});
      if (!road.camera_turns.empty()) out.back().in_plan.turn = road.camera_turns[k];
    }
  }
  return out;
}

/// The road along the driven path, with what it was fitted from.
struct DrivenRoad {
  detail::TravelFrame frame;
  NearRoad near;
  detail::CircularPath circle;
  detail::ProfileMeasurements measured;
  detail::DrivenProfile profile;
  bool is_wide = false;  ///< the narrow strip holds too few points
};

/// @param near_road  fit_near_plane or fit_near_parabola: where the fit starts.
/// @param level      roughly up, square to the direction of travel.
/// @return failure of its profile: why there is none.
DrivenRoad fit_driven_road(const RoadPoints& road, decltype(fit_near_plane) near_road,
                           const detail::TravelFrame& start, const Eigen::Vector3d& level,
                           const EgoPlaneOptions& options) {
  DrivenRoad out;
  out.frame = start;
  out.profile.failure = near_road(road, options.camera_height, &out.frame, &out.near);
  if (!out.profile.failure.empty()) return out;
  const double metres_per_baseline = options.camera_height / out.near.plane_height;
  const std::vector<CameraPosition> path = usable_path(road, out.frame, metres_per_baseline);
  std::vector<PlaceOnPath> in_plan;
  for (const CameraPosition& p : path) in_plan.push_back(p.in_plan);
  out.circle.curvature = path_curvature(in_plan, options.path) * metres_per_baseline;
  detail::ProfileMeasurements& measured = out.measured;
  measured.road = &road;
  measured.points.reserve(road.points.size());
  for (const Eigen::Vector3d& p : road.points) {
    measured.points.push_back(out.circle.along(out.frame.of(p)));
  }
  for (const CameraPosition& p : path) measured.path.push_back(out.circle.along(p.place));
  measured.level_cross_slope = -out.frame.right.dot(level) / out.frame.up.dot(level);
  measured.path_curvature = out.circle.curvature;
  out.profile = detail::fit_driven_profile(measured, metres_per_baseline, options);
  out.is_wide = !out.profile.failure.empty() || out.profile.points < options.narrow_points;
  if (out.is_wide) {
    EgoPlaneOptions wide = options;
    wide.half_width = options.wide_half_width;
    out.profile = detail::fit_driven_profile(measured, metres_per_baseline, wide);
  }
  return out;
}

/// What the same measurements give under other assumptions: another strip, that between the wheels
/// alone, a stiffer or softer road. @return variance of the logarithm of the scale.
double assumption_variance(const detail::ProfileMeasurements& measured,
                           const detail::DrivenProfile& chosen, const EgoPlaneOptions& options,
                           double other_half_width) {
  const auto log_change = [&](const EgoPlaneOptions& changed, int fewest) {
    const detail::DrivenProfile other =
        detail::fit_driven_profile(measured, chosen.metres_per_baseline, changed);
    return other.failure.empty() && other.points >= fewest
               ? std::log(other.metres_per_baseline / chosen.metres_per_baseline)
               : 0.0;
  };
  EgoPlaneOptions width = options, between_wheels = options, soft = options, stiff = options;
  width.half_width = other_half_width;
  between_wheels.half_width = options.start_half_width;
  soft.curvature_walk *= 2.0;
  stiff.curvature_walk *= 0.5;
  // The road's stiffness is known to a factor of two: half, the assumed one and twice it as 1:2:1.
  const double by_width = log_change(width, 0);
  const double by_kerb = log_change(between_wheels, options.narrow_points);
  const double by_soft = log_change(soft, 0), by_stiff = log_change(stiff, 0);
  return by_width * by_width + by_kerb * by_kerb + 0.25 * (by_soft * by_soft + by_stiff * by_stiff);
}

/// What a turn between the camera and the nearest road that is seen leaves open: a path that turns
/// leaves one fall of the road for another, and its slope changes by up to the fall times the sine
/// of the angle, somewhere in between.
/// @return variance of the logarithm of the scale.
double turn_variance(double path_curvature, const NearRoad& near, double metres_per_baseline,
                     const EgoPlaneOptions& options) {
  const double turned = std::min(std::abs(path_curvature) * near.begins, 0.5 * kPi);
  const double height =
      0.5 * metres_per_baseline * near.begins * options.cross_fall * std::sin(turned);
  return std::pow(height / options.camera_height, 2);
}

/// What the road that is passed unseen leaves open, between the camera's farthest position and the
/// nearest road that is seen: a bend that begins there, nobody knows where.
/// @return variance of the logarithm of the scale.
double bend_variance(const detail::ProfileMeasurements& measured,
                     const detail::DrivenProfile& profile, const NearRoad& near,
                     const EgoPlaneOptions& options) {
  double passed = 0.0;
  for (const Eigen::Vector3d& p : measured.path) passed = std::max(passed, p.y());
  const double unseen = std::clamp(1.0 - passed / near.begins, 0.0, 1.0);
  const double bend =
      std::log(profile.metres_per_baseline * near.plane_height / profile.camera_height());
  return std::pow(options.bend_share * unseen * unseen * bend, 2);
}

}  // namespace

void EgoPlaneOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(camera_height > 0, "camera_height", camera_height, "> 0");
  require(camera_height_sigma >= 0, "camera_height_sigma", camera_height_sigma, ">= 0");
  require(node_spacing > 0, "node_spacing", node_spacing, "> 0");
  require(reach > 8, "reach", reach, "> 8");
  require(half_width > 0, "half_width", half_width, "> 0");
  require(wide_half_width > half_width, "wide_half_width", wide_half_width, "> half_width");
  require(start_half_width > 0, "start_half_width", start_half_width, "> 0");
  require(path.curvature > 0, "path.curvature", path.curvature, "> 0");
  require(path.place > 0, "path.place", path.place, "> 0");
  require(travel_sigma > 0, "travel_sigma", travel_sigma, "> 0");
  require(path.turn > 0, "path.turn", path.turn, "> 0");
  require(cross_fall >= 0, "cross_fall", cross_fall, ">= 0");
  require(heave >= 0, "heave", heave, ">= 0");
  require(travel_reach > 0, "travel_reach", travel_reach, "> 0");
  require(curvature > 0, "curvature", curvature, "> 0");
  require(curvature_walk > 0, "curvature_walk", curvature_walk, "> 0");
  require(curve_begins > 0, "curve_begins", curve_begins, "> 0");
  require(curve_begins_most >= 1, "curve_begins_most", curve_begins_most, ">= 1");
  require(bend_share >= 0, "bend_share", bend_share, ">= 0");
  require(bank_walk > 0, "bank_walk", bank_walk, "> 0");
  require(roll_sigma > 0, "roll_sigma", roll_sigma, "> 0");
  require(rolled_sigma > 0, "rolled_sigma", rolled_sigma, "> 0");
  require(rolled_share >= 0 && rolled_share <= 1, "rolled_share", rolled_share, "in [0, 1]");
  require(surface_sigma > 0, "surface_sigma", surface_sigma, "> 0");
  require(correlation >= 1, "correlation", correlation, ">= 1");
  require(inflation >= 1, "inflation", inflation, ">= 1");
}

EgoPlane fit_ego_plane(const RoadPoints& road, const Eigen::Vector3d& travel,
                       const Eigen::Vector3d& up, const Eigen::MatrixXd& shared_covariance,
                       const EgoPlaneOptions& options) {
  options.validate();
  EgoPlane out;
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };
  const std::size_t count = road.points.size();
  if (!road.camera_turns.empty() && road.camera_turns.size() != road.camera_path.size()) {
    throw std::invalid_argument("camera_turns has " + std::to_string(road.camera_turns.size()) +
                                " entries, expected one for each of " +
                                std::to_string(road.camera_path.size()) + " positions");
  }
  if (count < 30) {
    return fail("too few road points: " + std::to_string(count) + ", expected at least 30");
  }

  const Eigen::Vector3d forward = travel.normalized();
  const Eigen::Vector3d level = (up - up.dot(forward) * forward).normalized();
  // x right, y down, z forward: z x (-y) = x
  const detail::TravelFrame start{forward.cross(level), forward, level};
  DrivenRoad driven = fit_driven_road(road, fit_near_plane, start, level, options);
  if (driven.profile.agreeing() < kMostAgree) {
    DrivenRoad other = fit_driven_road(road, fit_near_parabola, start, level, options);
    if (other.profile.agreeing() > driven.profile.agreeing()) driven = std::move(other);
  }
  const auto& [frame, near, circle, measured, profile, is_wide] = driven;
  if (!profile.failure.empty()) return fail(profile.failure);
  out.near_plane_height = near.plane_height;
  const double metres_per_baseline = profile.metres_per_baseline;
  EgoPlaneOptions chosen = options;
  if (is_wide) chosen.half_width = options.wide_half_width;
  const double assumptions =
      assumption_variance(measured, profile, chosen,
                          is_wide ? options.half_width : options.wide_half_width) +
      turn_variance(measured.path_curvature, near, metres_per_baseline, options) +
      bend_variance(measured, profile, near, options);
  const Eigen::Index columns = road.shared_jacobian.cols();
  Eigen::MatrixXd covariance = options.inflation * profile.covariance;
  if (columns > 0 && shared_covariance.size() > 0) {
    covariance += profile.shared * shared_covariance * profile.shared.transpose();
  }

  // Tangent plane under the camera.
  const int foot = profile.foot, nodes = profile.nodes;
  const double step = profile.step;
  const Eigen::Vector3d normal_vector =
      (frame.up - profile.slope() * forward - profile.cross_slope() * frame.right).normalized();
  const Eigen::Vector3d foot_on_axis = frame.up * (profile.x[foot] / metres_per_baseline);
  Plane plane = Plane::through(foot_on_axis, normal_vector);
  out.height = plane.offset;
  out.metres_per_baseline = options.camera_height / out.height;
  out.plane.plane = plane;
  out.plane.centroid = plane.foot(Eigen::Vector3d::Zero());
  UncertainPlane::make_axes(normal_vector, forward, &out.plane.axis1, &out.plane.axis2);
  // axis1 is forward, axis2 = n x axis1 is to the left; a tilt about axis1 is a change of the cross
  // slope, a tilt about axis2 one of the slope (see UncertainPlane: h + a axis2.r - b axis1.r).
  Eigen::MatrixXd functional = Eigen::MatrixXd::Zero(3, profile.x.size());
  functional(0, nodes + foot) = -1.0;
  functional(1, foot + 1) = -0.5 / step;
  functional(1, foot - 1) = 0.5 / step;
  functional(2, foot) = 1.0 / metres_per_baseline;
  out.plane.covariance = functional * covariance * functional.transpose();
  out.plane.covariance(2, 2) += out.height * out.height * assumptions;
  if (columns > 0) out.shared_jacobian = functional * profile.shared;
  const double height_share = options.camera_height_sigma / options.camera_height;
  out.relative_sigma = std::sqrt(out.plane.covariance(2, 2) / (out.height * out.height) +
                                 height_share * height_share);
  for (int j = foot; j < nodes; ++j) {
    const double ahead = (j - foot) * step / metres_per_baseline;
    const Eigen::Vector2d place = circle.at(ahead);
    out.line.push_back(forward * place.y() + frame.right * place.x() +
                       frame.up * (profile.x[j] / metres_per_baseline));
  }
  out.points = profile.points;
  out.compared = profile.compared;
  out.status = out.relative_sigma < 0.08 ? Status::kOk : Status::kWeak;
  if (out.status == Status::kWeak) {
    out.reason = "the height of the camera over the road is known to " +
                 std::to_string(static_cast<int>(std::lround(100 * out.relative_sigma))) + " %";
  }
  return out;
}

}  // namespace camber
