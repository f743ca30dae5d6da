#pragma once

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/sphere_manifold.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace camber::paper {

// Parameter blocks of the vehicles' joint problem. Camera frame, metres.
//   pose   camera_from_vehicle [qx qy qz qw tx ty tz] (7); the vehicle frame stands on the ground
//          with y up
//   form   length, width, height, then the shape coefficients (3 + K)
//   plane  [nx ny nz d] (4), n . x + d = 0, n unit and up
using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;
using PlaneManifold = ceres::ProductManifold<ceres::SphereManifold<3>, ceres::EuclideanManifold<1>>;

/// The vehicle's up axis in the camera frame.
template <typename T>
Eigen::Matrix<T, 3, 1> up_axis(const T* pose) {
  const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose);
  return rotation * Eigen::Matrix<T, 3, 1>(T(0), T(1), T(0));
}

/// A point of the vehicle frame in the camera frame.
template <typename T>
Eigen::Matrix<T, 3, 1> in_camera(const T* pose, const Eigen::Vector3d& point) {
  const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose);
  const Eigen::Map<const Eigen::Matrix<T, 3, 1>> translation(pose + 4);
  return rotation * point.cast<T>() + translation;
}

/// Height of a point above a plane.
template <typename T>
T height_above(const T* plane, const Eigen::Matrix<T, 3, 1>& x) {
  return plane[0] * x.x() + plane[1] * x.y() + plane[2] * x.z() + plane[3];
}

}  // namespace camber::paper
