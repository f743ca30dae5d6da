#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Core>

namespace camber {

/// Holds a plane at its own fit: residual = S x, where S' S is the inverse of the fit's covariance.
/// Unit: standard deviations. Parameter block: x = change of (tilt about axis1, tilt about axis2,
/// height at the centroid), rad, rad, m (3).
struct PlanePrior {
  Eigen::Matrix3d square_root_information;

  template <typename T>
  bool operator()(const T* x, T* residual) const {
    for (int i = 0; i < 3; ++i) {
      residual[i] = T(0.0);
      for (int j = 0; j < 3; ++j) residual[i] += square_root_information(i, j) * x[j];
    }
    return true;
  }
  static ceres::CostFunction* create(const Eigen::Matrix3d& square_root_information) {
    return new ceres::AutoDiffCostFunction<PlanePrior, 3, 3>(
        new PlanePrior{square_root_information});
  }
};

}  // namespace camber
