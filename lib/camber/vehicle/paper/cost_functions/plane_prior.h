#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Cholesky>

#include "camber/geometry/plane.h"
#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// A plane as the road gives it, with its covariance C: r = C^(-1/2) (tilt about axis1, tilt about
/// axis2, height at the centroid), in standard deviations.
/// Parameter block: plane (4).
struct VehiclePlanePrior {
  UncertainPlane known;
  Eigen::Matrix3d root_information;  ///< upper triangular U with U^T U = C^(-1)

  template <typename T>
  bool operator()(const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> normal(plane[0], plane[1], plane[2]);
    // n + (a axis1 + b axis2) x n = n - a axis2 + b axis1
    Eigen::Matrix<T, 3, 1> change;
    change[0] = -known.axis2.cast<T>().dot(normal);
    change[1] = known.axis1.cast<T>().dot(normal);
    change[2] = -height_above(plane, Eigen::Matrix<T, 3, 1>(known.centroid.cast<T>()));
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = root_information.cast<T>() * change;
    return true;
  }

  static ceres::CostFunction* create(const UncertainPlane& known) {
    const Eigen::Matrix3d information = known.covariance.inverse();
    return new ceres::AutoDiffCostFunction<VehiclePlanePrior, 3, 4>(
        new VehiclePlanePrior{known, information.llt().matrixU()});
  }
};

}  // namespace camber::paper
