#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

#include "camber/geometry/se3.h"

namespace camber {

/// Plane n . x + d = 0 with unit normal n, as in Eigen's Hyperplane and PCL's coefficients. A road
/// plane's normal points up, out of the road, and d is then the camera's signed height above it.
/// The paper writes n . X = d with n down: convert at readers and writers only.
struct Plane {
  Eigen::Vector3d normal{0.0, -1.0, 0.0};  ///< unit
  double offset = 0.0;                     ///< m

  /// Height of a point above the plane (positive on the normal's side), m.
  double signed_distance(const Eigen::Vector3d& x) const { return normal.dot(x) + offset; }

  /// Foot of the perpendicular from x.
  Eigen::Vector3d foot(const Eigen::Vector3d& x) const { return x - signed_distance(x) * normal; }

  /// The same plane in frame b: n_b = R n_a, d_b = d_a - n_b . t.
  Plane transformed(const SE3& b_from_a) const;

  /// The same plane with its normal on the side of `up`.
  Plane oriented(const Eigen::Vector3d& up) const;

  /// Point where the ray s * direction, s > 0, from the frame's origin meets the plane; nothing if
  /// it is parallel or meets it behind the origin.
  std::optional<Eigen::Vector3d> intersect_ray(const Eigen::Vector3d& direction) const;

  static Plane through(const Eigen::Vector3d& point, const Eigen::Vector3d& unit_normal) {
    return {unit_normal, -unit_normal.dot(point)};
  }
};

/// A plane with the covariance of its three degrees of freedom at a centroid.
///
/// The parameters are (tilt about axis1, tilt about axis2, height at the centroid along the
/// normal), in rad, rad, m; axis1 x axis2 = normal. A small change (a, b, h) gives the normal
/// n + (a axis1 + b axis2) x n and raises the plane at the in-plane offset r from the centroid by
/// h + a (axis2 . r) - b (axis1 . r).
struct UncertainPlane {
  Plane plane;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis1{1.0, 0.0, 0.0};
  Eigen::Vector3d axis2{0.0, 0.0, 1.0};
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();

  /// d(height at x along the normal) / d(a, b, h).
  Eigen::RowVector3d height_jacobian(const Eigen::Vector3d& x) const;

  /// Variance of the plane's height along its normal at x, m^2.
  double height_variance(const Eigen::Vector3d& x) const;

  /// The plane after a change (a, b, h) of its parameters.
  Plane perturbed(const Eigen::Vector3d& abh) const;

  /// The same in frame b: normal, axes and centroid turn with it, the covariance stays.
  UncertainPlane transformed(const SE3& b_from_a) const;

  /// Axes for a normal: axis1 as near as possible to `along` (its in-plane part), axis2 = n x
  /// axis1.
  static void make_axes(const Eigen::Vector3d& normal, const Eigen::Vector3d& along,
                        Eigen::Vector3d* axis1, Eigen::Vector3d* axis2);
};

/// Angle between two directions, radians in [0, pi].
double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

}  // namespace camber
