#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// The vehicle stands on its ground plane, L_g, equation 4: r = (n_g . t - d_g) / sigma with t the
/// bottom centre. Parameter blocks: pose (7), plane (4).
struct GroundConstraint {
  double sigma = 1.0;  ///< m

  template <typename T>
  bool operator()(const T* pose, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> foot(pose[4], pose[5], pose[6]);
    residual[0] = height_above(plane, foot) / T(-sigma);
    return true;
  }

  static ceres::CostFunction* create(double sigma) {
    return new ceres::AutoDiffCostFunction<GroundConstraint, 1, 7, 4>(new GroundConstraint{sigma});
  }
};

/// Equation 4 as printed, with the vehicle's normal and the ground's offset:
/// r = (n_c . t - d_g) / sigma. A vehicle at a distance z is off by z times the sine of the angle
/// between both normals. Parameter blocks: pose (7), form (3 + K), plane (4).
template <int K>
struct PrintedGroundConstraint {
  WheelLine wheels;
  double sigma = 1.0;  ///< m

  template <typename T>
  bool operator()(const T* pose, const T* form, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> foot(pose[4], pose[5], pose[6]);
    residual[0] = (turned(pose, wheel_normal<K>(form, wheels)).dot(foot) - plane[3]) / T(sigma);
    return true;
  }
};
inline ceres::CostFunction* create_printed_ground_constraint(const WheelLine& wheels,
                                                             double sigma) {
  return with_coefficients(wheels.rear.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    using Term = PrintedGroundConstraint<decltype(k)::value>;
    return new ceres::AutoDiffCostFunction<Term, 1, 7, 3 + decltype(k)::value, 4>(
        new Term{wheels, sigma});
  });
}

}  // namespace camber::paper
