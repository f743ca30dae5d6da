#pragma once

// Dense algebra that is compiled once: Eigen's kernels take seconds in every file that uses them.

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace camber::internal {

/// LDL^T factors of a symmetric matrix.
class SymmetricFactors {
 public:
  SymmetricFactors() = default;
  explicit SymmetricFactors(const Eigen::MatrixXd& matrix) { compute(matrix); }
  void compute(const Eigen::MatrixXd& matrix);
  /// Whether the factors could be formed and no pivot is negative.
  bool positive() const;
  Eigen::VectorXd solve(const Eigen::VectorXd& right) const;
  Eigen::MatrixXd solve_matrix(const Eigen::MatrixXd& right) const;
  Eigen::MatrixXd inverse() const;
  double log_determinant() const;  ///< of a positive matrix

 private:
  Eigen::LDLT<Eigen::MatrixXd> factors_;
};

/// a b
Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);
/// a^T b
Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);
/// *out += a a^T
void add_square(const Eigen::MatrixXd& a, Eigen::MatrixXd* out);

}  // namespace camber::internal
