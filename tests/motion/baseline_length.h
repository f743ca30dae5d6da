#pragma once

#include <ceres/autodiff_cost_function.h>

#include <cmath>

namespace camber {

/// Holds the length of a translation: r = (|t| - length) / sigma. Fixes the scale that images alone
/// leave open.
/// Parameter block: pose [qx qy qz qw tx ty tz] (7).
class BaselineLength {
 public:
  BaselineLength(double length, double sigma) : length_(length), sigma_(sigma) {}

  static ceres::CostFunction* create(double length, double sigma) {
    return new ceres::AutoDiffCostFunction<BaselineLength, 1, 7>(new BaselineLength(length, sigma));
  }

  template <typename T>
  bool operator()(const T* pose, T* residual) const {
    using std::sqrt;
    const T squared = pose[4] * pose[4] + pose[5] * pose[5] + pose[6] * pose[6];
    if (!(squared > T(0))) return false;
    residual[0] = (sqrt(squared) - length_) / sigma_;
    return true;
  }

 private:
  double length_, sigma_;
};

}  // namespace camber
