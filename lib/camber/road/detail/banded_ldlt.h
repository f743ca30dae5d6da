#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <cstddef>
#include <vector>

namespace camber::detail {

/// A symmetric matrix that is zero beyond `band` places off its diagonal: its lower triangle,
/// column by column from the diagonal down.
class SymmetricBand {
 public:
  SymmetricBand() = default;
  SymmetricBand(Eigen::Index size, Eigen::Index band) { set_zero(size, band); }
  void set_zero(Eigen::Index size, Eigen::Index band);

  Eigen::Index size() const { return size_; }
  Eigen::Index band() const { return band_; }
  /// @param row  from column to column + band.
  double& at(Eigen::Index row, Eigen::Index column) {
    return values_[static_cast<std::size_t>(column * (band_ + 1) + row - column)];
  }
  double at(Eigen::Index row, Eigen::Index column) const {
    return values_[static_cast<std::size_t>(column * (band_ + 1) + row - column)];
  }
  double* column(Eigen::Index j) { return values_.data() + j * (band_ + 1); }
  const double* column(Eigen::Index j) const { return values_.data() + j * (band_ + 1); }

 private:
  Eigen::Index size_ = 0, band_ = 0;
  std::vector<double> values_;
};

/// L D L' of a symmetric positive definite band matrix, without pivots or fill beyond the band: the
/// quickest factorisation of a grid. For many right sides see SparseLdlt.
class BandedLdlt {
 public:
  /// @return false: a pivot is zero or not finite.
  bool factorise(SymmetricBand matrix);

  /// Solves for every column; the same bits for a column whatever others stand beside it.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& right) const;
  Eigen::VectorXd solve_vector(const Eigen::VectorXd& right) const;
  /// Logarithm of the determinant of a positive definite matrix.
  double log_determinant() const;
  /// The entries of the inverse within the band (Takahashi, Fagan, Chin, "Formation of a Sparse Bus
  /// Impedance Matrix", 1973): in a chain's order the covariance of what is near each other.
  SymmetricBand inverse_in_band() const;

 private:
  SymmetricBand factor_;  // L below the diagonal, D on it
};

/// The same for a matrix whose band is mostly zeros, in an order that keeps most of them: slower to
/// factorise, with a third of the entries to solve by.
class SparseLdlt {
 public:
  /// @param matrix  positive definite.
  explicit SparseLdlt(const SymmetricBand& matrix);

  /// See BandedLdlt::solve().
  Eigen::MatrixXd solve(const Eigen::MatrixXd& right) const;

 private:
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
};

}  // namespace camber::detail
