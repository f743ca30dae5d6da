#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Cholesky>

#include "camber/geometry/plane.h"
#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// Part of L_reg: the ground plane stays near the estimate that the road points (or whoever gave
/// the plane) made, with covariance C: r = C^(-1/2) (tilt about axis1, tilt about axis2, height at
/// the centroid), in standard deviations. No other term measures the plane but by the vehicle on
/// it. Parameter block: plane (4).
struct PlaneRegulariser {
  UncertainPlane known;
  Eigen::Matrix3d root_information;  ///< upper triangular U with U^T U = C^(-1)

  template <typename T>
  bool operator()(const T* plane, T* residual) const {
    // n + (a axis1 + b axis2) x n = n - a axis2 + b axis1, with n up
    const Eigen::Matrix<T, 3, 1> turn =
        -Eigen::Map<const Eigen::Matrix<T, 3, 1>>(plane) - known.plane.normal.cast<T>();
    Eigen::Matrix<T, 3, 1> change;
    change[0] = -known.axis2.cast<T>().dot(turn);
    change[1] = known.axis1.cast<T>().dot(turn);
    change[2] = T(known.plane.signed_distance(known.centroid)) -
                height_above(plane, Eigen::Matrix<T, 3, 1>(known.centroid.cast<T>()));
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = root_information.cast<T>() * change;
    return true;
  }

  static ceres::CostFunction* create(const UncertainPlane& known) {
    const Eigen::Matrix3d information = known.covariance.inverse();
    return new ceres::AutoDiffCostFunction<PlaneRegulariser, 3, 4>(
        new PlaneRegulariser{known, information.llt().matrixU()});
  }
};

}  // namespace camber::paper
