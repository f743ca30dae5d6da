#include "camber/road/local_plane.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace camber {

constexpr double kFarthest = 300.0;  // m, of a contact

void LocalPlaneOptions::validate() const {
  const auto require = [](bool holds, const char* name, double value, const char* bound) {
    if (!holds) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  require(length > 0.0, "length", length, "greater than 0");
  require(half_width > 0.0, "half_width", half_width, "greater than 0");
  require(std::isfinite(bumper_overhang), "bumper_overhang", bumper_overhang, "finite");
  require(uneven_height >= 0.0, "uneven_height", uneven_height, "at least 0");
  require(uneven_tilt >= 0.0, "uneven_tilt", uneven_tilt, "at least 0");
}

UncertainPlane plane_from_inverse_depth(const Eigen::Vector3d& m, const Eigen::Matrix3d& covariance,
                                        const Eigen::Vector3d& centroid,
                                        Eigen::Matrix3d* parameters) {
  // m = -n / d. Points of the plane satisfy m . x = 1.
  UncertainPlane out;
  const double length = m.norm();
  Eigen::Vector3d normal = -m / length;  // a camera above the road: d > 0, n = -m d
  double offset = 1.0 / length;
  if (normal.y() > 0) {  // the camera is below the plane, beyond a crest or on a steep climb
    normal = -normal;
    offset = -offset;
  }
  out.plane = {normal, offset};
  out.centroid = out.plane.foot(centroid);
  UncertainPlane::make_axes(normal, Eigen::Vector3d(out.centroid.x(), 0.0, out.centroid.z()),
                            &out.axis1, &out.axis2);
  // A change dm moves the plane at x along its normal by dh: (m + dm) . (x + dh n) = 1, so
  // dh = -dm . x / (m . n) to first order.
  const double mn = m.dot(normal);
  const auto height = [&](const Eigen::Vector3d& x) -> Eigen::RowVector3d {
    return -x.transpose() / mn;
  };
  Eigen::Matrix3d j;
  const Eigen::RowVector3d at_centroid = height(out.centroid);
  j.row(0) = height(out.centroid + out.axis2) - at_centroid;     // h + a (axis2 . r)
  j.row(1) = -(height(out.centroid + out.axis1) - at_centroid);  // - b (axis1 . r)
  j.row(2) = at_centroid;
  out.covariance = j * covariance * j.transpose();
  if (parameters) *parameters = j;
  return out;
}

LocalPlane fit_local_plane(const RoadPosterior& road, const PinholeCamera& camera,
                           const Eigen::Vector2d& contact, const LocalPlaneOptions& options) {
  LocalPlane out;
  const double rho0 = road.inverse_depth(contact);
  if (!(rho0 > 1.0 / kFarthest)) {
    out.status = Status::kFailed;
    out.reason = "the ray to the contact does not meet the ground";
    return out;
  }
  const double near = 1.0 / rho0 + options.bumper_overhang, far = near + options.length;

  // Rows of the image from the contact upwards (and a little below) that see the footprint.
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Eigen::Vector3d> points;
  const auto add = [&](const Eigen::Vector2d& pixel) {
    const double rho = road.inverse_depth(pixel);
    if (!(rho > 0)) return;
    pixels.push_back(pixel);
    points.push_back(camera.ray(pixel) / rho);
    out.observed += road.observed(pixel);
  };
  double last_depth = 0.0;
  const double step = std::clamp((contact.y() - road.top()) / 60.0, 0.5, 4.0);
  for (double v = contact.y() + 2.0 * step; v > road.top(); v -= step) {
    const double rho_mid = road.inverse_depth({contact.x(), v});
    if (!(rho_mid > 0)) break;
    const double depth = 1.0 / rho_mid;
    if (depth < last_depth) break;  // beyond a crest: another stretch of road
    last_depth = depth;
    if (depth > far) break;
    if (depth < near - 0.1 * options.length) continue;
    const double half_px = options.half_width * camera.fx * rho_mid;
    for (const double side : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
      add({contact.x() + side * half_px, v});
    }
  }
  if (points.size() < 15) {
    // A far footprint lies within a row or two: take the field's tangent around the contact.
    pixels.clear();
    points.clear();
    out.observed = 0.0;
    const double half_px = std::max(2.0, options.half_width * camera.fx * rho0);
    for (const double dv : {1.5, 0.5, -0.5, -1.5}) {
      for (const double side : {-1.0, 0.0, 1.0}) {
        add({contact.x() + side * half_px, contact.y() + dv});
      }
    }
  }
  if (points.size() < 3) {
    out.status = Status::kFailed;
    out.reason = "the ground under the box is not in view";
    return out;
  }
  // Each row stands for the depth between its neighbours: weight by the metric step z^2 and turn
  // inverse-depth residuals into heights (dh = drho / (rho |m|)).
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::MatrixXd left(3, static_cast<Eigen::Index>(points.size()));
  Eigen::VectorXd rho(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double z = points[i].z();
    const double w = z * z * z * z;
    const Eigen::Vector3d ray = points[i] / z;
    normal += w * ray * ray.transpose();
    left.col(static_cast<Eigen::Index>(i)) = w * ray;
    rho[static_cast<Eigen::Index>(i)] = 1.0 / z;
  }
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(normal);
  if (!lu.isInvertible()) {
    out.status = Status::kFailed;
    out.reason = "the footprint is seen edge-on";
    return out;
  }
  const Eigen::MatrixXd coefficients = lu.solve(left);
  const Eigen::Vector3d m = coefficients * rho;
  // Nobody drives on more; what is seen there is a wall, or a field that nothing holds.
  constexpr double kSteepest = 0.7;  // rad
  if (!(std::abs(m.y()) > 0) || std::hypot(m.x(), m.z()) > std::tan(kSteepest) * std::abs(m.y())) {
    out.status = Status::kFailed;
    out.reason = "what is seen there is too steep for a road";
    return out;
  }
  const Eigen::Matrix3d covariance = road.covariance(road.of_inverse_depths(pixels, coefficients));
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) centroid += p / static_cast<double>(points.size());
  Eigen::Matrix3d parameters;
  out.plane = plane_from_inverse_depth(m, covariance, centroid, &parameters);
  out.plane.covariance.diagonal() += options.uneven_variances();
  out.by_inverse_depth = parameters * coefficients;
  out.pixels = std::move(pixels);
  out.observed /= static_cast<double>(points.size());
  out.status = Status::kOk;
  return out;
}

Eigen::MatrixXd joint_covariance(const RoadPosterior& road, const std::vector<LocalPlane>& planes,
                                 const LocalPlaneOptions& options) {
  std::vector<RoadFunctionals> parts;
  for (const LocalPlane& p : planes) {
    parts.push_back(road.of_inverse_depths(p.pixels, p.by_inverse_depth));
  }
  Eigen::MatrixXd out = planes.empty() ? Eigen::MatrixXd() : road.covariance(joined(parts));
  for (Eigen::Index i = 0; i < out.rows(); i += 3) {
    out.diagonal().segment<3>(i) += options.uneven_variances();
  }
  return out;
}

}  // namespace camber
