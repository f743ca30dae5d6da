#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Core>

namespace camber {

/// Two planes have the same height at a place: residual = (step + jb . xb - ja . xa) / sigma, the
/// step of b above a along up at the place. Unit: standard deviations. Parameter blocks: xa, xb =
/// changes of (tilt, tilt, height) of plane a and b (3, 3).
struct HeightContinuity {
  double step;              ///< m, before any change
  Eigen::RowVector3d a, b;  ///< d(height along up) / d(x) of each plane at the place
  double sigma;             ///< m, > 0

  template <typename T>
  bool operator()(const T* xa, const T* xb, T* residual) const {
    T difference = T(step);
    for (int i = 0; i < 3; ++i) difference += b[i] * xb[i] - a[i] * xa[i];
    residual[0] = difference / sigma;
    return true;
  }
  static ceres::CostFunction* create(double step, const Eigen::RowVector3d& a,
                                     const Eigen::RowVector3d& b, double sigma) {
    return new ceres::AutoDiffCostFunction<HeightContinuity, 1, 3, 3>(
        new HeightContinuity{step, a, b, sigma});
  }
};

}  // namespace camber
