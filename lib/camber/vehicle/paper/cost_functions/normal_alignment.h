#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// The vehicle's normal is its ground's, L_n, equation 5: r = (n_c x n_g) / sigma, three sines of
/// tilt, rad. Parameter blocks: pose (7), form (3 + K), plane (4).
template <int K>
struct NormalAlignment {
  WheelLine wheels;
  double sigma = 1.0;  ///< rad

  template <typename T>
  bool operator()(const T* pose, const T* form, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> ground(plane[0], plane[1], plane[2]);
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = turned(pose, wheel_normal<K>(form, wheels)).cross(ground) / T(sigma);
    return true;
  }
};
inline ceres::CostFunction* create_normal_alignment(const WheelLine& wheels, double sigma) {
  return with_coefficients(wheels.rear.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    using Term = NormalAlignment<decltype(k)::value>;
    return new ceres::AutoDiffCostFunction<Term, 3, 7, 3 + decltype(k)::value, 4>(
        new Term{wheels, sigma});
  });
}

}  // namespace camber::paper
