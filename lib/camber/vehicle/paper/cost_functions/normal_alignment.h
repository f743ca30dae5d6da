#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// The vehicle's up axis is its plane's normal, equation 6 of the paper: r = (up x n) / sigma,
/// three sines of tilt, rad. Parameter blocks: pose (7), plane (4).
struct NormalAlignment {
  double sigma = 1.0;  ///< rad

  template <typename T>
  bool operator()(const T* pose, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> normal(plane[0], plane[1], plane[2]);
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = up_axis(pose).cross(normal) / T(sigma);
    return true;
  }

  static ceres::CostFunction* create(double sigma) {
    return new ceres::AutoDiffCostFunction<NormalAlignment, 3, 7, 4>(new NormalAlignment{sigma});
  }
};

}  // namespace camber::paper
