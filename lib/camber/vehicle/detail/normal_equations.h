#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "camber/vehicle/vehicle_estimate.h"

namespace camber::internal {

/// What the coefficients leave of a vehicle's keypoints, m in its frame at the prior's mean size.
using ShapeErrors = Eigen::Matrix<double, 3, kNumKeypoints>;

/// Second derivatives (Gauss-Newton) and gradient of a minus log density.
struct NormalEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  void set_zero(Eigen::Index size) {
    hessian.setZero(size, size);
    gradient.setZero(size);
  }
};

/// Where a run of a term's own parameters lies among all.
struct ParameterRun {
  int all, own, length;
};

/// Adds a term's normal equations to those of all parameters.
void scatter(const Eigen::Ref<const Eigen::MatrixXd>& hessian,
             const Eigen::Ref<const Eigen::VectorXd>& gradient,
             const std::vector<ParameterRun>& runs, NormalEquations* all);

/// Of the keypoints' shape errors in one view: their own 3 x 3 blocks, and with the parameters of
/// the view.
struct ShapeErrorEquations {
  std::array<Eigen::Matrix3d, kNumKeypoints> own;
  ShapeErrors gradient;
  Eigen::MatrixXd cross;  ///< 3 rows a keypoint, a column a parameter
  void set_zero(Eigen::Index size) {
    own.fill(Eigen::Matrix3d::Zero());
    gradient.setZero();
    cross.setZero(3 * kNumKeypoints, size);
  }
};

}  // namespace camber::internal
