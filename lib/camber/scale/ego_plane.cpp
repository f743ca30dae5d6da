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

/// Robust plane through points: u = c + alpha b + beta a in a road frame.
Eigen::Vector3d robust_plane(const std::vector<Eigen::Vector3d>& abu, double noise) {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  std::vector<double> weight(abu.size(), 1.0);
  for (int iteration = 0; iteration < 6; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-9;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < abu.size(); ++i) {
      const Eigen::Vector3d row(1.0, abu[i].y(), abu[i].x());
      normal += weight[i] * row * row.transpose();
      right += weight[i] * row * abu[i].z();
    }
    x = normal.ldlt().solve(right);
    for (std::size_t i = 0; i < abu.size(); ++i) {
      const double r = abu[i].z() - x.dot(Eigen::Vector3d(1.0, abu[i].y(), abu[i].x()));
      weight[i] = 1.0 / std::pow(1.0 + r * r / (noise * noise), 2);  // Geman and McClure
    }
  }
  return x;
}

/// The nearest road that is seen, unit of the points.
struct NearRoad {
  double plane_height = 0.0;  ///< of the camera above the plane through it
  double begins = 0.0;        ///< ahead of the camera
};

/// Turns the frame about the direction of travel to the cross slope of the nearest road, whose
/// height below the camera gives a first scale: near points lie about one camera height below the
/// travelled line. @return why there is none; empty: there is one.
std::string fit_near_plane(const RoadPoints& road, double camera_height, detail::TravelFrame* frame,
                           NearRoad* out) {
  std::vector<Eigen::Vector3d> abu;
  abu.reserve(road.points.size());
  std::vector<double> ahead;
  const auto below_and_ahead = [](const Eigen::Vector3d& p) {
    return p.y() > 0 && p.z() < 0 && std::abs(p.x()) < p.y();
  };
  for (const Eigen::Vector3d& p : road.points) {
    abu.push_back(frame->of(p));
    if (below_and_ahead(abu.back())) ahead.push_back(abu.back().y());
  }
  if (ahead.size() < 30) return "too few road points ahead of and below the camera";
  std::sort(ahead.begin(), ahead.end());
  const double nearest = ahead[ahead.size() / 50];
  std::vector<double> below;
  for (const Eigen::Vector3d& p : abu) {
    if (below_and_ahead(p) && p.y() <= ahead[ahead.size() / 4]) below.push_back(-p.z());
  }
  std::nth_element(below.begin(), below.begin() + static_cast<std::ptrdiff_t>(below.size() / 2),
                   below.end());
  double height = below[below.size() / 2];
  for (int round = 0; round < 4; ++round) {
    const double window = std::max(1.3 * nearest, nearest + 6.0 / camera_height * height);
    std::vector<Eigen::Vector3d> near;
    for (const Eigen::Vector3d& p : abu) {
      if (p.y() > 0 && p.y() < window && std::abs(p.x()) < 0.6 * p.y() &&
          std::abs(p.z() + height) < 0.5 * height) {
        near.push_back(p);
      }
    }
    if (near.size() < 20) return "too few road points near the camera";
    const Eigen::Vector3d plane = robust_plane(near, (round == 0 ? 0.1 : 0.03) * height);
    if (!(plane.x() < 0)) return "the nearest points do not lie below the camera";
    height = -plane.x() / std::sqrt(1.0 + plane.y() * plane.y() + plane.z() * plane.z());
    frame->up = (frame->up - plane.z() * frame->right).normalized();
    frame->right = frame->forward.cross(frame->up);
    for (std::size_t i = 0; i < abu.size(); ++i) abu[i] = frame->of(road.points[i]);
  }
  *out = {height, nearest};
  return "";
}

/// The same by a parabola that leaves the foot under the camera along the direction of travel, for
/// roads that rise ahead so soon that a plane through what is seen of them does not pass below the
/// camera.
std::string fit_near_parabola(const RoadPoints& road, double /*camera_height*/,
                              detail::TravelFrame* frame, NearRoad* out) {
  constexpr double kWindow = 4.0;           // of the distance to the nearest road
  constexpr double kCrossSlope = 0.1;       // rad, standard deviation
  constexpr double kNoise = 0.03;           // of a point's height over its distance
  constexpr int kRounds = 8, kFewest = 30;  // points
  std::vector<Eigen::Vector3d> abu;
  std::vector<double> ahead;
  for (const Eigen::Vector3d& p : road.points) {
    abu.push_back(frame->of(p));
    if (abu.back().y() > 0) ahead.push_back(abu.back().y());
  }
  if (ahead.size() < kFewest) return "too few road points ahead of the camera";
  std::sort(ahead.begin(), ahead.end());
  const double nearest = ahead[ahead.size() / 50];
  std::vector<Eigen::Vector3d> near;
  for (const Eigen::Vector3d& p : abu) {
    if (p.y() > 0 && p.y() < kWindow * nearest && std::abs(p.x()) < 0.6 * p.y()) near.push_back(p);
  }
  if (near.size() < kFewest) return "too few road points near the camera";
  Eigen::Vector3d x = Eigen::Vector3d::Zero();  // height of the foot, cross slope, curvature
  double noise = std::numeric_limits<double>::infinity();  // of a distance, share
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    normal(1, 1) = kNoise * kNoise / (kCrossSlope * kCrossSlope);
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : near) {
      const Eigen::Vector3d row(1.0, p.x(), 0.5 * p.y() * p.y());
      const double r = (p.z() - x.dot(row)) / p.y();
      const double weight = 1.0 / (p.y() * p.y() * std::pow(1.0 + r * r / (noise * noise), 2));
      normal += weight * row * row.transpose();
      right += weight * row * p.z();
    }
    x = normal.ldlt().solve(right);
    noise = round < kRounds / 2 ? 0.1 : kNoise;
  }
  if (!(x[0] < 0)) return "the nearest points do not lie below the camera";
  frame->up = (frame->up - x[1] * frame->right).normalized();
  frame->right = frame->forward.cross(frame->up);
  *out = {-x[0] / std::hypot(1.0, x[1]), nearest};
  return "";
}

/// A position of the camera on its path, in the travel frame.
struct CameraPosition {
  Eigen::Vector3d place;
  std::optional<double> turn;  ///< rad, to the right
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
      out.push_back({q, std::nullopt});
      if (!road.camera_turns.empty()) out.back().turn = road.camera_turns[k];
    }
  }
  return out;
}

/// Curvature in plan of the path, by the camera's positions and how far it has turned there,
/// 1 / unit.
double path_curvature(const std::vector<CameraPosition>& path, double metres_per_baseline,
                      const EgoPlaneOptions& options) {
  double information = 1.0 / (options.path_curvature * options.path_curvature), moment = 0.0;
  const auto add = [&](double by_curvature, double value, double sigma) {
    information += by_curvature * by_curvature / (sigma * sigma);
    moment += by_curvature * value / (sigma * sigma);
  };
  for (const CameraPosition& p : path) {
    const Eigen::Vector3d q = metres_per_baseline * p.place;
    add(0.5 * q.y() * q.y(), q.x(), options.path_sigma);
    if (p.turn) add(q.y(), *p.turn, options.heading_sigma);
  }
  return moment / information * metres_per_baseline;
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
  out.circle.curvature = path_curvature(path, metres_per_baseline, options);
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
  require(path_curvature > 0, "path_curvature", path_curvature, "> 0");
  require(path_sigma > 0, "path_sigma", path_sigma, "> 0");
  require(travel_sigma > 0, "travel_sigma", travel_sigma, "> 0");
  require(heading_sigma > 0, "heading_sigma", heading_sigma, "> 0");
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
