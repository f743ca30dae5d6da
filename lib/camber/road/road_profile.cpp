#include "camber/road/road_profile.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/road/plan_polygon.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kLeastCover = 0.6;  // share of the length that must be covered
constexpr double kStraight = 1e-5;   // 1/m, curvatures below it are called straight

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
}

std::vector<ProfilePoint> road_profile(const RoadSurface& surface,
                                       const std::vector<Vector3d>& line,
                                       const ProfileOptions& options) {
  options.validate();
  const Vector3d up = surface.up.normalized();
  const GroundAxes axes(up);
  // Corners at different places in plan, with their stations.
  std::vector<Vector3d> corners;
  std::vector<double> stations;
  for (const Vector3d& corner : line) {
    if (!corner.allFinite()) continue;
    if (corners.empty()) {
      corners.push_back(corner);
      stations.push_back(0.0);
      continue;
    }
    const double way = (axes(corner) - axes(corners.back())).norm();
    if (!(way > 1e-9)) continue;
    corners.push_back(corner);
    stations.push_back(stations.back() + way);
  }
  if (corners.size() < 2) {
    throw std::invalid_argument(fmt::format(
        "road_profile: the line has {} different places, expected at least 2", corners.size()));
  }

  std::vector<ProfilePoint> profile;
  std::vector<Vector3d> lefts;
  std::size_t piece = 0;
  const double total = stations.back();
  constexpr double kMostStations = 1e6;
  if (!(total / options.step < kMostStations)) {
    throw std::invalid_argument(
        fmt::format("ProfileOptions::step is {:g}, expected more than {:g} m for a line of {:g} m",
                    options.step, total / kMostStations, total));
  }
  const auto steps = static_cast<std::size_t>(std::floor(total / options.step + 1e-9));
  for (std::size_t k = 0; k <= steps; ++k) {
    const double station = std::min(static_cast<double>(k) * options.step, total);
    while (piece + 2 < stations.size() && station > stations[piece + 1]) ++piece;
    const double share = (station - stations[piece]) / (stations[piece + 1] - stations[piece]);
    const Vector3d place = corners[piece] + share * (corners[piece + 1] - corners[piece]);
    const Vector2d flat = (axes(corners[piece + 1]) - axes(corners[piece])).normalized();
    const Vector3d ahead = flat.x() * axes.e1 + flat.y() * axes.e2, left = up.cross(ahead);
    ProfilePoint point;
    point.station = station;
    point.point = place;
    const SurfaceQuery answer = surface.query(place, options.reach);
    point.status = answer.status;
    point.reason = answer.reason;
    lefts.push_back(left);
    if (answer.status != Status::kFailed) {
      const Vector3d& n = answer.plane.plane.normal;
      const double slant = n.dot(up);
      point.patch = answer.patch;
      point.point = answer.point;
      point.height = answer.point.dot(up);
      point.cross_slope = -n.dot(left) / slant;
      point.sigma_height = answer.sigma_height / slant;
      point.sigma_grade = sigma_slope(answer.plane, up, ahead);
      point.sigma_cross_slope = sigma_slope(answer.plane, up, left);
    }
    profile.push_back(std::move(point));
  }

  // Grade and curvature from the heights around each station.
  const auto half =
      static_cast<std::size_t>(std::max(1.0, std::round(0.5 * options.length / options.step)));
  for (std::size_t k = 0; k < profile.size(); ++k) {
    ProfilePoint& here = profile[k];
    if (here.status == Status::kFailed) continue;
    const std::size_t begin = k >= half ? k - half : 0,
                      end = std::min(profile.size() - 1, k + half);
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    double count = 0.0;
    for (std::size_t j = begin; j <= end; ++j) {
      if (profile[j].status == Status::kFailed) continue;
      const double s = profile[j].station - here.station;
      const Vector3d row(1.0, s, 0.5 * s * s);
      normal += row * row.transpose();
      right += (profile[j].height - here.height) * row;
      count += 1.0;
    }
    if (count < kLeastCover * static_cast<double>(2 * half + 1) || count < 3.0) continue;
    // A straight line for the grade where the window is symmetric; at its ends the parabola's
    // slope at the station, for the line's would be that of another station.
    const Vector3d parabola = normal.fullPivLu().solve(right);
    if (!parabola.allFinite()) continue;
    here.grade = parabola[1];
    const double grade2 = 1.0 + here.grade * here.grade;
    const double curvature = parabola[2] / (grade2 * std::sqrt(grade2));
    here.vertical_radius =
        std::abs(curvature) > kStraight ? 1.0 / curvature : std::numeric_limits<double>::infinity();
  }
  return profile;
}

}  // namespace camber
