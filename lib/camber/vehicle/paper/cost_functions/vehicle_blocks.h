#pragma once

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/sphere_manifold.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <stdexcept>
#include <type_traits>

#include "camber/geometry/plane.h"

namespace camber::paper {

// Parameter blocks of the vehicles' joint problem. Camera frame, metres.
//   pose   camera_from_vehicle [qx qy qz qw tx ty tz] (7); the vehicle frame stands on the ground
//          with y up
//   form   length, width, height, then K shape coefficients (3 + K)
//   plane  [nx ny nz d] (4), n . x = d, n unit and down: the paper's convention, not Plane's
using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;
using PlaneManifold = ceres::ProductManifold<ceres::SphereManifold<3>, ceres::EuclideanManifold<1>>;

/// The one place where planes change from Camber's convention (n . x + d = 0, n up) to the paper's
/// (n . x = d, n down) and back.
inline Eigen::Vector4d to_paper(const Plane& plane) {
  Eigen::Vector4d out;
  out << -plane.normal, plane.offset;
  return out;
}
inline Plane from_paper(const Eigen::Vector4d& block) { return {-block.head<3>(), block[3]}; }

/// A point of the vehicle as shares of its box: mean + basis a, to be multiplied by (length,
/// height, width) along (x, y, z).
struct WireframePoint {
  Eigen::Vector3d mean;
  Eigen::Matrix<double, 3, Eigen::Dynamic> basis;  ///< 3 x K
};

/// The line from the rear to the front wheel centres of one side. The wireframe is symmetric to
/// z = 0, so that the four centres lie in one plane, which is their least-squares plane: it holds
/// the z axis and this line.
struct WheelLine {
  WireframePoint rear, front;
};

/// Calls make with std::integral_constant<int, K> for the K that equals count.
/// @throws std::invalid_argument for others than 0, 5, 10, 15 and 20.
template <class Make>
auto with_coefficients(Eigen::Index count, const Make& make)
    -> decltype(make(std::integral_constant<int, 0>())) {
  switch (count) {
    case 0:
      return make(std::integral_constant<int, 0>());
    case 5:
      return make(std::integral_constant<int, 5>());
    case 10:
      return make(std::integral_constant<int, 10>());
    case 15:
      return make(std::integral_constant<int, 15>());
    case 20:
      return make(std::integral_constant<int, 20>());
    default:
      throw std::invalid_argument("coefficients: must be 0, 5, 10, 15 or 20");
  }
}

/// A point of the vehicle frame for a form, m.
template <int K, typename T>
Eigen::Matrix<T, 3, 1> in_vehicle(const T* form, const WireframePoint& point) {
  Eigen::Matrix<T, 3, 1> share = point.mean.cast<T>();
  for (int k = 0; k < K; ++k) {
    for (int i = 0; i < 3; ++i) {
      if (point.basis(i, k) != 0.0) share[i] += point.basis(i, k) * form[3 + k];
    }
  }
  return {form[0] * share.x(), form[2] * share.y(), form[1] * share.z()};
}

/// The vehicle's normal n_c in the vehicle frame: of the least-squares plane of the four wheel
/// centres, unit, down. A function of the form, no variable of its own.
template <int K, typename T>
Eigen::Matrix<T, 3, 1> wheel_normal(const T* form, const WheelLine& wheels) {
  using std::sqrt;
  const Eigen::Matrix<T, 3, 1> line =
      in_vehicle<K>(form, wheels.front) - in_vehicle<K>(form, wheels.rear);
  const T length = sqrt(line.x() * line.x() + line.y() * line.y());
  return {line.y() / length, -line.x() / length, T(0)};
}

/// A direction of the vehicle frame in the camera frame.
template <typename T>
Eigen::Matrix<T, 3, 1> turned(const T* pose, const Eigen::Matrix<T, 3, 1>& direction) {
  const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose);
  return rotation * direction;
}

/// Height of a point above a plane of the paper's convention.
template <typename T>
T height_above(const T* plane, const Eigen::Matrix<T, 3, 1>& x) {
  return plane[3] - plane[0] * x.x() - plane[1] * x.y() - plane[2] * x.z();
}

}  // namespace camber::paper
