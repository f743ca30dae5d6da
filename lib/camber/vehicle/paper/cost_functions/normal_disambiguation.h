#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// Which way is up, equation 7 of the paper. Equation 6 holds for a vehicle on its roof as well. As
/// printed the term is even in the normal, r = (1 - (up . g)^2) / sigma, and cannot decide either;
/// the default is one-sided: r = max(0, limit - up . g) / sigma, nothing for a vehicle within
/// acos(limit) of upright.
/// Parameter block: pose (7).
struct NormalDisambiguation {
  Eigen::Vector3d up{0.0, -1.0, 0.0};  ///< g, camera frame, unit
  double sigma = 1.0;
  double limit = 0.7;  ///< cosine; roads are not steeper than this
  bool as_printed = false;

  template <typename T>
  bool operator()(const T* pose, T* residual) const {
    const T cosine = up_axis(pose).dot(up.cast<T>());
    if (as_printed) {
      residual[0] = (T(1) - cosine * cosine) / T(sigma);
    } else {
      residual[0] = cosine < T(limit) ? T((T(limit) - cosine) / T(sigma)) : T(0);
    }
    return true;
  }

  static ceres::CostFunction* create(const Eigen::Vector3d& up, double sigma,
                                     bool as_printed = false) {
    return new ceres::AutoDiffCostFunction<NormalDisambiguation, 1, 7>(
        new NormalDisambiguation{up, sigma, 0.7, as_printed});
  }
};

}  // namespace camber::paper
