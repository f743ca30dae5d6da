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
// m, over which what planes leave out, and a cloud's drift, are alike along the road; across it a
// patch's slope is off by what it leaves out over such a length.
constexpr double kUnmodelledLength = 8.0, kDriftLength = 20.0, kUnmodelledAcross = 3.5;

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

/// A station with what the errors of its height are made of.
struct Station {
  ProfilePoint point;
  UncertainPlane plane;
  Eigen::RowVector3d jacobian = Eigen::RowVector3d::Zero();  ///< d height / d plane parameters
  double unmodelled = 0.0;                                   ///< m
};

/// Variance of a weighted sum of the values of a process with the covariance
/// sigma_i sigma_j exp(-|s_i - s_j| / length), added station by station in their order.
class ProcessVariance {
 public:
  explicit ProcessVariance(double length) : length_(length) {}
  void add(double station, double weighted_sigma) {
    carried_ *= std::exp(-(station - last_) / length_);
    variance_ += weighted_sigma * (weighted_sigma + 2.0 * carried_);
    carried_ += weighted_sigma;
    last_ = station;
  }
  double variance() const { return variance_; }

 private:
  double length_, last_ = 0.0, carried_ = 0.0, variance_ = 0.0;
};

/// The grade's variance: that of the sum of weights times heights of stations [begin, begin +
/// weights.size()).
double grade_variance(const std::vector<Station>& stations, std::size_t begin,
                      const std::vector<double>& weights, double drift, double levelling) {
  ProcessVariance unmodelled(kUnmodelledLength), drifting(kDriftLength);
  double variance = levelling * levelling;
  // Stations on one patch err together.
  Eigen::RowVector3d jacobian = Eigen::RowVector3d::Zero();
  const Station* on = nullptr;
  const auto close = [&] {
    if (on) variance += jacobian * on->plane.covariance * jacobian.transpose();
    jacobian.setZero();
  };
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const Station& station = stations[begin + i];
    if (station.point.status == Status::kFailed) continue;
    if (on && on->point.patch != station.point.patch) close();
    on = &station;
    jacobian += weights[i] * station.jacobian;
    unmodelled.add(station.point.station, weights[i] * station.unmodelled);
    drifting.add(station.point.station, weights[i] * drift);
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

/// The stations of a line with what is known at each by itself.
std::vector<Station> find_stations(const RoadSurface& surface, const std::vector<Vector3d>& line,
                                   const ProfileOptions& options) {
  const Vector3d up = surface.up.normalized();
  const GroundAxes axes(up);
  const Corners corners(line, axes);
  if (corners.places.size() < 2) {
    throw std::invalid_argument(
        fmt::format("road_profile: the line has {} different places, expected at least 2",
                    corners.places.size()));
  }
  const double total = corners.stations.back();
  constexpr double kMostStations = 1e6;
  if (!(total / options.step < kMostStations)) {
    throw std::invalid_argument(
        fmt::format("ProfileOptions::step is {:g}, expected more than {:g} m for a line of {:g} m",
                    options.step, total / kMostStations, total));
  }
  std::vector<Station> stations;
  std::size_t piece = 0;
  const auto steps = static_cast<std::size_t>(std::floor(total / options.step + 1e-9));
  for (std::size_t k = 0; k <= steps; ++k) {
    const double at = std::min(static_cast<double>(k) * options.step, total);
    while (piece + 2 < corners.stations.size() && at > corners.stations[piece + 1]) ++piece;
    const Vector3d &from = corners.places[piece], &to = corners.places[piece + 1];
    const double share =
        (at - corners.stations[piece]) / (corners.stations[piece + 1] - corners.stations[piece]);
    const Vector3d place = from + share * (to - from);
    const Vector2d flat = (axes(to) - axes(from)).normalized();
    const Vector3d ahead = flat.x() * axes.e1 + flat.y() * axes.e2, left = up.cross(ahead);
    Station station;
    ProfilePoint& point = station.point;
    point.station = at;
    point.point = place;
    const SurfaceQuery answer = surface.query(place, options.reach);
    point.status = answer.status;
    point.reason = answer.reason;
    if (answer.status != Status::kFailed) {
      const Vector3d& n = answer.plane.plane.normal;
      const double slant = n.dot(up);
      point.patch = answer.patch;
      point.point = answer.point;
      point.height = answer.point.dot(up);
      point.cross_slope = -n.dot(left) / slant;
      station.plane = answer.plane;
      station.jacobian = answer.plane.height_jacobian(answer.point) / slant;
      station.unmodelled = surface.find(answer.patch)->unmodelled_sigma / slant;
      point.sigma_height = answer.sigma_height / slant;
      point.sigma_cross_slope =
          std::hypot(sigma_slope(answer.plane, up, left), station.unmodelled / kUnmodelledAcross,
                     options.levelling_sigma);
    }
    stations.push_back(std::move(station));
  }
  return stations;
}

/// Grade, vertical radius and the grade's standard deviation of station k, from the heights
/// `half` stations around it.
void measure_grade(std::size_t k, std::size_t half, double drift, double levelling,
                   std::vector<Station>* stations) {
  ProfilePoint& here = (*stations)[k].point;
  const std::size_t begin = k >= half ? k - half : 0,
                    end = std::min(stations->size() - 1, k + half);
  const auto row = [&](std::size_t j) {
    const double s = (*stations)[j].point.station - here.station;
    return Vector3d(1.0, s, 0.5 * s * s);
  };
  const auto covered = [&](std::size_t j) {
    return (*stations)[j].point.status != Status::kFailed;
  };
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  double count = 0.0;
  for (std::size_t j = begin; j <= end; ++j) {
    if (!covered(j)) continue;
    normal += row(j) * row(j).transpose();
    right += ((*stations)[j].point.height - here.height) * row(j);
    count += 1.0;
  }
  if (count < kLeastCover * static_cast<double>(2 * half + 1) || count < 3.0) return;
  // A straight line for the grade where the window is symmetric; at its ends the parabola's slope
  // at the station, for the line's would be that of another station.
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(normal);
  const Vector3d parabola = lu.solve(right);
  if (!parabola.allFinite()) return;
  here.grade = parabola[1];
  const double grade2 = 1.0 + here.grade * here.grade;
  const double curvature = parabola[2] / (grade2 * std::sqrt(grade2));
  here.vertical_radius =
      std::abs(curvature) > kStraight ? 1.0 / curvature : std::numeric_limits<double>::infinity();
  const Vector3d to_slope = lu.solve(Vector3d::UnitY());  // normal is symmetric
  std::vector<double> weights;
  for (std::size_t j = begin; j <= end; ++j) {
    weights.push_back(covered(j) ? to_slope.dot(row(j)) : 0.0);
  }
  here.sigma_grade = std::sqrt(grade_variance(*stations, begin, weights, drift, levelling));
}

}  // namespace

std::vector<ProfilePoint> road_profile(const RoadSurface& surface,
                                       const std::vector<Vector3d>& line,
                                       const ProfileOptions& options) {
  options.validate();
  std::vector<Station> stations = find_stations(surface, line, options);
  const auto half =
      static_cast<std::size_t>(std::max(1.0, std::round(0.5 * options.length / options.step)));
  const double drift = surface.metric ? options.drift_sigma : 0.0;
  const double middle = 0.5 * stations.back().point.station;
  std::vector<ProfilePoint> profile;
  for (std::size_t k = 0; k < stations.size(); ++k) {
    if (stations[k].point.status == Status::kFailed) continue;
    measure_grade(k, half, drift, options.levelling_sigma, &stations);
  }
  for (Station& station : stations) {
    ProfilePoint& point = station.point;
    // The cloud may be turned about the middle of the line, as far as stations go.
    point.sigma_height =
        std::hypot(point.sigma_height, drift, options.levelling_sigma * (point.station - middle));
    profile.push_back(std::move(point));
  }
  return profile;
}

}  // namespace camber
