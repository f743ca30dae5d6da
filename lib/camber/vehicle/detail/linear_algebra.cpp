#include "camber/vehicle/detail/linear_algebra.h"

#include "camber/geometry/detail/dense_product.h"

namespace camber::internal {

void SymmetricFactors::compute(const Eigen::MatrixXd& matrix) { factors_.compute(matrix); }

bool SymmetricFactors::positive() const {
  return factors_.info() == Eigen::Success && factors_.isPositive();
}

Eigen::VectorXd SymmetricFactors::solve(const Eigen::VectorXd& right) const {
  return factors_.solve(right);
}

Eigen::MatrixXd SymmetricFactors::solve_matrix(const Eigen::MatrixXd& right) const {
  return factors_.solve(right);
}

Eigen::MatrixXd SymmetricFactors::inverse() const {
  return factors_.solve(Eigen::MatrixXd::Identity(factors_.rows(), factors_.cols()));
}

double SymmetricFactors::log_determinant() const { return factors_.vectorD().array().log().sum(); }

Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return camber::detail::product(a, b);
}

Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return camber::detail::transposed_product(a, b);
}

void add_square(const Eigen::MatrixXd& a, Eigen::MatrixXd* out) {
  *out += camber::detail::square(a);
}

}  // namespace camber::internal
