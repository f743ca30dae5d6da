#pragma once

#include <ceres/cost_function.h>
#include <ceres/normal_prior.h>

#include <Eigen/Core>

namespace camber::paper {

/// Part of L_reg: the dimensions alone, r = ((l, w, h) - mean) / sigma.
/// Parameter block: form (3 + K).
struct DimensionRegulariser {
  static ceres::CostFunction* create(const Eigen::Vector3d& mean, const Eigen::Vector3d& sigma,
                                     int num_coefficients) {
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(3, 3 + num_coefficients);
    a.leftCols<3>() = sigma.cwiseInverse().asDiagonal();
    Eigen::VectorXd b = Eigen::VectorXd::Zero(3 + num_coefficients);
    b.head<3>() = mean;
    return new ceres::NormalPrior(a, b);
  }
};

/// Part of L_reg: the shape alone (the coefficients have variance 1), r = a / sigma.
/// Parameter block: form (3 + K).
struct ShapeRegulariser {
  static ceres::CostFunction* create(int num_coefficients, double sigma) {
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(num_coefficients, 3 + num_coefficients);
    a.rightCols(num_coefficients).diagonal().setConstant(1.0 / sigma);
    return new ceres::NormalPrior(a, Eigen::VectorXd::Zero(3 + num_coefficients));
  }
};

}  // namespace camber::paper
