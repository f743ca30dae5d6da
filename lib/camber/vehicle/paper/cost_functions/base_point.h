#pragma once

#include <ceres/autodiff_cost_function.h>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"

namespace camber::paper {

/// A base point (a wheel's contact, a bumper's lower corner) is as high above the ground as above
/// the vehicle's bottom, L_b, equation 7: r = (n_g . (R b + t) - d_g + b.y) / sigma.
/// Parameter blocks: pose (7), form (3 + K), plane (4).
template <int K>
struct BasePoint {
  WireframePoint point;  ///< b
  double sigma = 1.0;    ///< m

  template <typename T>
  bool operator()(const T* pose, const T* form, const T* plane, T* residual) const {
    const Eigen::Matrix<T, 3, 1> b = in_vehicle<K>(form, point);
    const Eigen::Matrix<T, 3, 1> foot(pose[4], pose[5], pose[6]);
    const Eigen::Matrix<T, 3, 1> x = turned(pose, b) + foot;
    residual[0] = (b.y() - height_above(plane, x)) / T(sigma);
    return true;
  }
};
inline ceres::CostFunction* create_base_point(const WireframePoint& point, double sigma) {
  return with_coefficients(point.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    using Term = BasePoint<decltype(k)::value>;
    return new ceres::AutoDiffCostFunction<Term, 1, 7, 3 + decltype(k)::value, 4>(
        new Term{point, sigma});
  });
}

/// Equation 7 as printed, with the vehicle's own plane, that of its wheel centres: r = (n_c . b -
/// d_c) / sigma. It holds for any pose and any ground, and acts on the form alone: it draws the
/// bumpers' lower corners to the height of the wheel centres. Parameter block: form (3 + K).
template <int K>
struct PrintedBasePoint {
  WireframePoint point;
  WheelLine wheels;
  double sigma = 1.0;  ///< m

  template <typename T>
  bool operator()(const T* form, T* residual) const {
    const Eigen::Matrix<T, 3, 1> off =
        in_vehicle<K>(form, point) - in_vehicle<K>(form, wheels.rear);
    residual[0] = wheel_normal<K>(form, wheels).dot(off) / T(sigma);
    return true;
  }
};
inline ceres::CostFunction* create_printed_base_point(const WireframePoint& point,
                                                      const WheelLine& wheels, double sigma) {
  return with_coefficients(point.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    using Term = PrintedBasePoint<decltype(k)::value>;
    return new ceres::AutoDiffCostFunction<Term, 1, 3 + decltype(k)::value>(
        new Term{point, wheels, sigma});
  });
}

}  // namespace camber::paper
