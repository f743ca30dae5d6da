#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// Neighbouring planes agree, L_c, equation 8: r = ((n1 - n2) / sigma_normal, (d1 - d2) /
/// sigma_offset). On a curved road neighbours rightly differ in both, in d by their angle times
/// their distance from the camera: see PlaneContinuity.
/// Parameter blocks: plane (4), plane (4).
struct VehiclePlaneConsistency {
  double sigma_normal = 1.0;  ///< rad
  double sigma_offset = 1.0;  ///< m

  template <typename T>
  bool operator()(const T* plane1, const T* plane2, T* residual) const {
    for (int i = 0; i < 3; ++i) residual[i] = (plane1[i] - plane2[i]) / T(sigma_normal);
    residual[3] = (plane1[3] - plane2[3]) / T(sigma_offset);
    return true;
  }

  static ceres::CostFunction* create(double sigma_normal, double sigma_offset) {
    return new ceres::AutoDiffCostFunction<VehiclePlaneConsistency, 4, 4, 4>(
        new VehiclePlaneConsistency{sigma_normal, sigma_offset});
  }
};

/// In the place of equation 8: neighbouring planes meet, with equal heights at the midpoint between
/// the two footprints, whatever their slopes: r = (n1 . m + d1 - n2 . m - d2) / sigma, m = (t1 +
/// t2) / 2. Parameter blocks: pose (7), pose (7), plane (4), plane (4).
struct PlaneContinuity {
  double sigma = 1.0;  ///< m

  template <typename T>
  bool operator()(const T* pose1, const T* pose2, const T* plane1, const T* plane2,
                  T* residual) const {
    Eigen::Matrix<T, 3, 1> middle;
    for (int i = 0; i < 3; ++i) middle[i] = T(0.5) * (pose1[4 + i] + pose2[4 + i]);
    residual[0] = (height_above(plane1, middle) - height_above(plane2, middle)) / T(sigma);
    return true;
  }

  static ceres::CostFunction* create(double sigma) {
    return new ceres::AutoDiffCostFunction<PlaneContinuity, 1, 7, 7, 4, 4>(
        new PlaneContinuity{sigma});
  }
};

}  // namespace camber::paper
