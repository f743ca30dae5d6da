#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// Which of two opposite normals, L_d, equation 6: equation 5 holds for a vehicle on its roof as
/// well. With the cosine c = n_c . n_g, as meant one-sided: r = max(0, limit - c) / sigma, nothing
/// for a vehicle within acos(limit) of its ground's normal. As printed the term is even in the
/// normals and has poles where they are perpendicular, r = (1 / c^2 - 1) / sigma: it repeats
/// equation 5 and does not separate up from down.
/// Parameter blocks: pose (7), form (3 + K), plane (4). Fails on a pole.
template <int K>
struct NormalDisambiguation {
  WheelLine wheels;
  double sigma = 1.0;
  double limit = 0.7;
  bool printed = false;

  template <typename T>
  bool operator()(const T* pose, const T* form, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> ground(plane[0], plane[1], plane[2]);
    const T cosine = turned(pose, wheel_normal<K>(form, wheels)).dot(ground);
    if (printed) {
      if (!(cosine * cosine > T(1e-6))) return false;
      residual[0] = (T(1) / (cosine * cosine) - T(1)) / T(sigma);
    } else {
      residual[0] = cosine < T(limit) ? T((T(limit) - cosine) / T(sigma)) : T(0);
    }
    return true;
  }
};
inline ceres::CostFunction* create_normal_disambiguation(const WheelLine& wheels, double sigma,
                                                         bool printed) {
  return with_coefficients(wheels.rear.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    using Term = NormalDisambiguation<decltype(k)::value>;
    return new ceres::AutoDiffCostFunction<Term, 1, 7, 3 + decltype(k)::value, 4>(
        new Term{wheels, sigma, 0.7, printed});
  });
}

}  // namespace camber::paper
