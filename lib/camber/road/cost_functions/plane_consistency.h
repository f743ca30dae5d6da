#pragma once

#include <ceres/autodiff_cost_function.h>

#include <Eigen/Core>

#include "camber/geometry/plane.h"

namespace camber {

/// The paper's equation 8: neighbouring planes have alike normals and offsets,
/// residual = [(n_b - n_a) / normal_sigma, (d_b - d_a) / offset_sigma], d measured from `origin` so
/// that the far origin of a map does not turn a tilt into an offset. Unit: standard deviations.
/// Parameter blocks: xa, xb = changes of (tilt, tilt, height) of plane a and b (3, 3).
struct PlaneConsistency {
  UncertainPlane a, b;
  Eigen::Vector3d origin;
  double normal_sigma;  ///< rad, > 0
  double offset_sigma;  ///< m, > 0

  template <typename T>
  static void change(const UncertainPlane& plane, const Eigen::Vector3d& origin, const T* x,
                     Eigen::Matrix<T, 3, 1>* normal, T* offset) {
    const Eigen::Matrix<T, 3, 1> n = plane.plane.normal.cast<T>();
    const Eigen::Matrix<T, 3, 1> turned =
        n - x[0] * plane.axis2.cast<T>() + x[1] * plane.axis1.cast<T>();
    *normal = turned.normalized();
    const Eigen::Matrix<T, 3, 1> anchor = plane.centroid.cast<T>() + x[2] * n;
    *offset = -normal->dot(anchor - origin.cast<T>());
  }

  template <typename T>
  bool operator()(const T* xa, const T* xb, T* residual) const {
    Eigen::Matrix<T, 3, 1> na, nb;
    T da, db;
    change(a, origin, xa, &na, &da);
    change(b, origin, xb, &nb, &db);
    for (int i = 0; i < 3; ++i) residual[i] = (nb[i] - na[i]) / normal_sigma;
    residual[3] = (db - da) / offset_sigma;
    return true;
  }
  static ceres::CostFunction* create(const UncertainPlane& a, const UncertainPlane& b,
                                     const Eigen::Vector3d& origin, double normal_sigma,
                                     double offset_sigma) {
    return new ceres::AutoDiffCostFunction<PlaneConsistency, 4, 3, 3>(
        new PlaneConsistency{a, b, origin, normal_sigma, offset_sigma});
  }
};

}  // namespace camber
