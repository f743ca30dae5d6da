#include "camber/road/detail/banded_ldlt.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/core/target_clones.h"

namespace camber::detail {
namespace {

/// Columns that are solved side by side.
constexpr int kPanel = 8;

/// Column by column, each taken out of the later ones that it reaches.
CAMBER_TARGET_CLONES("avx2")
bool eliminate(std::ptrdiff_t size, std::ptrdiff_t band, double* values) {
  const std::ptrdiff_t pitch = band + 1;
  for (std::ptrdiff_t j = 0; j < size; ++j) {
    double* const pivot = values + j * pitch;
    const double d = pivot[0];
    if (d == 0.0 || !std::isfinite(d)) return false;
    const std::ptrdiff_t last = std::min(band, size - 1 - j);
    for (std::ptrdiff_t k = 1; k <= last; ++k) {
      const double share = pivot[k] / d;
      if (share == 0.0) continue;
      double* __restrict to = values + (j + k) * pitch;
      const double* __restrict from = pivot + k;
      for (std::ptrdiff_t i = 0; i <= last - k; ++i) to[i] -= share * from[i];
    }
    const double inverse = 1.0 / d;
    for (std::ptrdiff_t k = 1; k <= last; ++k) pivot[k] *= inverse;
  }
  return true;
}

/// @param first  row above which the right sides are zero
/// @param x      kPanel right sides, row by row; replaced by the solutions
CAMBER_TARGET_CLONES("avx2")
void solve_panel(std::ptrdiff_t size, std::ptrdiff_t band, const double* factor,
                 std::ptrdiff_t first, double* x) {
  const std::ptrdiff_t pitch = band + 1;
  for (std::ptrdiff_t j = first; j < size; ++j) {
    const double* const l = factor + j * pitch;
    const std::ptrdiff_t last = std::min(band, size - 1 - j);
    double here[kPanel];
    for (int c = 0; c < kPanel; ++c) here[c] = x[j * kPanel + c];
    for (std::ptrdiff_t k = 1; k <= last; ++k) {
      double* __restrict to = x + (j + k) * kPanel;
      for (int c = 0; c < kPanel; ++c) to[c] -= l[k] * here[c];
    }
  }
  for (std::ptrdiff_t j = size - 1; j >= 0; --j) {
    const double* const l = factor + j * pitch;
    const std::ptrdiff_t last = std::min(band, size - 1 - j);
    double sum[kPanel];
    for (int c = 0; c < kPanel; ++c) sum[c] = x[j * kPanel + c] / l[0];
    for (std::ptrdiff_t k = 1; k <= last; ++k) {
      const double* from = x + (j + k) * kPanel;
      for (int c = 0; c < kPanel; ++c) sum[c] -= l[k] * from[c];
    }
    for (int c = 0; c < kPanel; ++c) x[j * kPanel + c] = sum[c];
  }
}

/// A unit lower triangle, column by column without its diagonal.
struct SparseFactor {
  std::ptrdiff_t size;
  const int* first;  // entry of each column, and one behind the last
  const int* row;
  const double* value;
  const double* diagonal;
};

/// See solve_panel().
CAMBER_TARGET_CLONES("avx2")
void solve_sparse_panel(const SparseFactor& factor, double* x) {
  for (std::ptrdiff_t j = 0; j < factor.size; ++j) {
    double here[kPanel];
    bool any = false;
    for (int c = 0; c < kPanel; ++c) {
      here[c] = x[j * kPanel + c];
      any |= here[c] != 0.0;
    }
    if (!any) continue;
    for (int k = factor.first[j]; k < factor.first[j + 1]; ++k) {
      double* __restrict to = x + static_cast<std::ptrdiff_t>(factor.row[k]) * kPanel;
      for (int c = 0; c < kPanel; ++c) to[c] -= factor.value[k] * here[c];
    }
  }
  for (std::ptrdiff_t j = factor.size - 1; j >= 0; --j) {
    double sum[kPanel];
    for (int c = 0; c < kPanel; ++c) sum[c] = x[j * kPanel + c] / factor.diagonal[j];
    for (int k = factor.first[j]; k < factor.first[j + 1]; ++k) {
      const double* from = x + static_cast<std::ptrdiff_t>(factor.row[k]) * kPanel;
      for (int c = 0; c < kPanel; ++c) sum[c] -= factor.value[k] * from[c];
    }
    for (int c = 0; c < kPanel; ++c) x[j * kPanel + c] = sum[c];
  }
}

}  // namespace

void SymmetricBand::set_zero(Eigen::Index size, Eigen::Index band) {
  size_ = size;
  band_ = std::max<Eigen::Index>(0, std::min(band, size - 1));
  values_.assign(static_cast<std::size_t>(size_ * (band_ + 1)), 0.0);
}

bool BandedLdlt::factorise(SymmetricBand matrix) {
  factor_ = std::move(matrix);
  return eliminate(factor_.size(), factor_.band(), factor_.column(0));
}

Eigen::MatrixXd BandedLdlt::solve(const Eigen::MatrixXd& right) const {
  Eigen::MatrixXd out(right.rows(), right.cols());
  Eigen::Matrix<double, Eigen::Dynamic, kPanel, Eigen::RowMajor> panel(right.rows(), kPanel);
  for (Eigen::Index first = 0; first < right.cols(); first += kPanel) {
    const Eigen::Index count = std::min<Eigen::Index>(kPanel, right.cols() - first);
    panel.setZero();
    panel.leftCols(count) = right.middleCols(first, count);
    Eigen::Index top = 0;
    while (top < panel.rows() && panel.row(top).isZero(0.0)) ++top;
    solve_panel(factor_.size(), factor_.band(), factor_.column(0), top, panel.data());
    out.middleCols(first, count) = panel.leftCols(count);
  }
  return out;
}

SparseLdlt::SparseLdlt(const SymmetricBand& matrix) {
  std::vector<Eigen::Triplet<double>> entries;
  for (Eigen::Index j = 0; j < matrix.size(); ++j) {
    const double* column = matrix.column(j);
    for (Eigen::Index k = 0; k <= std::min(matrix.band(), matrix.size() - 1 - j); ++k) {
      if (column[k] != 0.0)
        entries.emplace_back(static_cast<int>(j + k), static_cast<int>(j), column[k]);
    }
  }
  Eigen::SparseMatrix<double> sparse(matrix.size(), matrix.size());
  sparse.setFromTriplets(entries.begin(), entries.end());
  factor_.compute(sparse);
}

Eigen::MatrixXd SparseLdlt::solve(const Eigen::MatrixXd& right) const {
  const auto& lower = factor_.matrixL().nestedExpression();
  const Eigen::VectorXd diagonal = factor_.vectorD();
  const SparseFactor factor{lower.cols(), lower.outerIndexPtr(), lower.innerIndexPtr(),
                            lower.valuePtr(), diagonal.data()};
  const auto& place = factor_.permutationP().indices();
  Eigen::MatrixXd out(right.rows(), right.cols());
  Eigen::Matrix<double, Eigen::Dynamic, kPanel, Eigen::RowMajor> panel(right.rows(), kPanel);
  for (Eigen::Index first = 0; first < right.cols(); first += kPanel) {
    const Eigen::Index count = std::min<Eigen::Index>(kPanel, right.cols() - first);
    panel.setZero();
    for (Eigen::Index c = 0; c < count; ++c) {
      for (Eigen::Index i = 0; i < right.rows(); ++i) panel(place[i], c) = right(i, first + c);
    }
    solve_sparse_panel(factor, panel.data());
    for (Eigen::Index c = 0; c < count; ++c) {
      for (Eigen::Index i = 0; i < right.rows(); ++i) out(i, first + c) = panel(place[i], c);
    }
  }
  return out;
}

}  // namespace camber::detail
