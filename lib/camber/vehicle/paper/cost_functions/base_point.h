#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// A base point (a wheel's contact, a bumper's lower corner) keeps its height above the ground,
/// equation 9 of the paper: r = (n . (R b + t) + d - h) / sigma, with b fixed in the vehicle frame,
/// turning with it, and h = b.y its height there. As printed n and d are the vehicle's own plane
/// (n = up, d = -up . t), so that nothing is drawn to the ground: r = (up . (R b + t) + d - h) /
/// sigma = 0 for any pose; the default takes the ground's. Parameter blocks: pose (7), plane (4).
struct BasePoint {
  Eigen::Vector3d point;  ///< b, vehicle frame, m
  double sigma = 1.0;     ///< m
  bool as_printed = false;

  template <typename T>
  bool operator()(const T* pose, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> x = in_camera(pose, point);
    if (as_printed) {
      const Eigen::Matrix<T, 3, 1> up = up_axis(pose), foot(pose[4], pose[5], pose[6]);
      residual[0] = up.dot(x) - up.dot(foot);
    } else {
      residual[0] = height_above(plane, x);
    }
    residual[0] = (residual[0] - T(point.y())) / T(sigma);
    return true;
  }

  static ceres::CostFunction* create(const Eigen::Vector3d& point, double sigma,
                                     bool as_printed = false) {
    return new ceres::AutoDiffCostFunction<BasePoint, 1, 7, 4>(
        new BasePoint{point, sigma, as_printed});
  }
};

}  // namespace camber::paper
