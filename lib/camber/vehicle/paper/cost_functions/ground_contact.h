#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// The vehicle stands on its plane, equation 5 of the paper: r = (n . t + d) / sigma with t the
/// bottom centre. As printed n is the vehicle's own up axis; the default takes the ground's normal.
/// Parameter blocks: pose (7), plane (4).
struct GroundContact {
  double sigma = 1.0;       ///< m
  bool as_printed = false;  ///< the vehicle's normal with the ground's distance

  template <typename T>
  bool operator()(const T* pose, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> foot(pose[4], pose[5], pose[6]);
    residual[0] = as_printed ? T(up_axis(pose).dot(foot) + plane[3]) : height_above(plane, foot);
    residual[0] /= T(sigma);
    return true;
  }

  static ceres::CostFunction* create(double sigma, bool as_printed = false) {
    return new ceres::AutoDiffCostFunction<GroundContact, 1, 7, 4>(
        new GroundContact{sigma, as_printed});
  }
};

}  // namespace camber::paper
