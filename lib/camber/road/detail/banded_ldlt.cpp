#include "camber/road/detail/banded_ldlt.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/core/target_clones.h"

#define CAMBER_ALWAYS_INLINE inline __attribute__((always_inline))

namespace camber::detail {
namespace {

/// Takes a pivot's column out of a later one.
CAMBER_ALWAYS_INLINE void take_out(double share, const double* __restrict from,
                                   std::ptrdiff_t count, double* __restrict to) {
  for (std::ptrdiff_t i = 0; i < count; ++i) to[i] -= share * from[i];
}

/// Four columns at a time, each taken out of those behind it in the block, then all of them at once
/// out of the later ones that they reach.
CAMBER_TARGET_CLONES("avx2")
bool eliminate(std::ptrdiff_t size, std::ptrdiff_t band, double* values) {
  constexpr std::ptrdiff_t kBlock = 4;
  const std::ptrdiff_t pitch = band + 1;
  for (std::ptrdiff_t j = 0; j < size; j += kBlock) {
    const std::ptrdiff_t block = std::min(kBlock, size - j);
    double inverse[kBlock];
    for (std::ptrdiff_t p = 0; p < block; ++p) {
      const double* const pivot = values + (j + p) * pitch;
      if (pivot[0] == 0.0 || !std::isfinite(pivot[0])) return false;
      inverse[p] = 1.0 / pivot[0];
      const std::ptrdiff_t last = std::min(band, size - 1 - j - p);
      for (std::ptrdiff_t k = 1; k <= std::min(last, block - 1 - p); ++k) {
        take_out(pivot[k] * inverse[p], pivot + k, last - k + 1, values + (j + p + k) * pitch);
      }
    }
    for (std::ptrdiff_t t = j + block; t <= std::min(j + block - 1 + band, size - 1); ++t) {
      double* __restrict const to = values + t * pitch;
      const double* from[kBlock];
      double share[kBlock];
      std::ptrdiff_t count[kBlock];  // entries of the column that each pivot reaches
      for (std::ptrdiff_t p = 0; p < block; ++p) {
        count[p] = std::max<std::ptrdiff_t>(0, std::min(j + p + band, size - 1) - t + 1);
        from[p] = values + (j + p) * pitch + (t - j - p);
        share[p] = count[p] > 0 ? from[p][0] * inverse[p] : 0.0;
      }
      std::ptrdiff_t all = 0;
      if (block == kBlock && count[0] > 0) {
        all = count[0];
        const double* __restrict a = from[0];
        const double* __restrict b = from[1];
        const double* __restrict c = from[2];
        const double* __restrict d = from[3];
        for (std::ptrdiff_t i = 0; i < all; ++i) {
          to[i] -= (share[0] * a[i] + share[1] * b[i]) + (share[2] * c[i] + share[3] * d[i]);
        }
      }
      for (std::ptrdiff_t p = 0; p < block; ++p) {
        take_out(share[p], from[p] + all, count[p] - all, to + all);
      }
    }
    for (std::ptrdiff_t p = 0; p < block; ++p) {
      double* const pivot = values + (j + p) * pitch;
      for (std::ptrdiff_t k = 1; k <= std::min(band, size - 1 - j - p); ++k) {
        pivot[k] *= inverse[p];
      }
    }
  }
  return true;
}

/// A lower triangle with its pivots, column by column: a band, or the entries of a sparse one.
struct BandFactor {
  std::ptrdiff_t size, band;
  const double* values;  // pivot, then what is below it
};
struct SparseFactor {
  std::ptrdiff_t size;
  const int* first;  // entry of each column, and one behind the last
  const int* row;
  const double* value;
  const double* pivot;
};

/// Right sides stand row by row, `wide` of them, and are replaced by the solutions.
/// @param first  row above which they are zero
template <int wide>
CAMBER_ALWAYS_INLINE void solve_wide(const BandFactor& f, std::ptrdiff_t first, double* x) {
  for (std::ptrdiff_t j = first; j < f.size; ++j) {
    const double* const l = f.values + j * (f.band + 1);
    const std::ptrdiff_t last = std::min(f.band, f.size - 1 - j);
    double here[wide];
    for (int c = 0; c < wide; ++c) here[c] = x[j * wide + c];
    for (std::ptrdiff_t k = 1; k <= last; ++k) {
      double* __restrict to = x + (j + k) * wide;
      for (int c = 0; c < wide; ++c) to[c] -= l[k] * here[c];
    }
  }
  for (std::ptrdiff_t j = f.size - 1; j >= 0; --j) {
    const double* const l = f.values + j * (f.band + 1);
    const std::ptrdiff_t last = std::min(f.band, f.size - 1 - j);
    double sum[wide];
    for (int c = 0; c < wide; ++c) sum[c] = x[j * wide + c] / l[0];
    for (std::ptrdiff_t k = 1; k <= last; ++k) {
      const double* from = x + (j + k) * wide;
      for (int c = 0; c < wide; ++c) sum[c] -= l[k] * from[c];
    }
    for (int c = 0; c < wide; ++c) x[j * wide + c] = sum[c];
  }
}

template <int wide>
CAMBER_ALWAYS_INLINE void solve_wide(const SparseFactor& f, double* x) {
  for (std::ptrdiff_t j = 0; j < f.size; ++j) {
    double here[wide];
    bool any = false;
    for (int c = 0; c < wide; ++c) {
      here[c] = x[j * wide + c];
      any |= here[c] != 0.0;
    }
    if (!any) continue;
    for (int k = f.first[j]; k < f.first[j + 1]; ++k) {
      double* __restrict to = x + static_cast<std::ptrdiff_t>(f.row[k]) * wide;
      for (int c = 0; c < wide; ++c) to[c] -= f.value[k] * here[c];
    }
  }
  for (std::ptrdiff_t j = f.size - 1; j >= 0; --j) {
    double sum[wide];
    for (int c = 0; c < wide; ++c) sum[c] = x[j * wide + c] / f.pivot[j];
    for (int k = f.first[j]; k < f.first[j + 1]; ++k) {
      const double* from = x + static_cast<std::ptrdiff_t>(f.row[k]) * wide;
      for (int c = 0; c < wide; ++c) sum[c] -= f.value[k] * from[c];
    }
    for (int c = 0; c < wide; ++c) x[j * wide + c] = sum[c];
  }
}

/// A single right side; sums in four parts, since one waits for itself.
CAMBER_TARGET_CLONES("avx2")
void solve_one(const BandFactor& f, std::ptrdiff_t first, double* x) {
  for (std::ptrdiff_t j = first; j < f.size; ++j) {
    const double* __restrict l = f.values + j * (f.band + 1);
    const std::ptrdiff_t last = std::min(f.band, f.size - 1 - j);
    const double here = x[j];
    double* __restrict to = x + j;
    for (std::ptrdiff_t k = 1; k <= last; ++k) to[k] -= l[k] * here;
  }
  for (std::ptrdiff_t j = f.size - 1; j >= 0; --j) {
    const double* __restrict l = f.values + j * (f.band + 1);
    const std::ptrdiff_t last = std::min(f.band, f.size - 1 - j);
    const double* __restrict from = x + j;
    double parts[4] = {};
    std::ptrdiff_t k = 1;
    for (; k + 3 <= last; k += 4) {
      for (int c = 0; c < 4; ++c) parts[c] += l[k + c] * from[k + c];
    }
    for (; k <= last; ++k) parts[0] += l[k] * from[k];
    x[j] = x[j] / l[0] - ((parts[0] + parts[1]) + (parts[2] + parts[3]));
  }
}

CAMBER_TARGET_CLONES("avx2")
void solve_four(const BandFactor& f, std::ptrdiff_t first, double* x) {
  solve_wide<4>(f, first, x);
}
CAMBER_TARGET_CLONES("avx2")
void solve_eight(const BandFactor& f, std::ptrdiff_t first, double* x) {
  solve_wide<8>(f, first, x);
}
CAMBER_TARGET_CLONES("avx2")
void solve_four(const SparseFactor& f, double* x) { solve_wide<4>(f, x); }
CAMBER_TARGET_CLONES("avx2")
void solve_eight(const SparseFactor& f, double* x) { solve_wide<8>(f, x); }

/// Solves side by side as many columns as there are, by eights and fours.
/// @param solve  of a panel, with the number of its columns
template <class Solve>
Eigen::MatrixXd by_panels(const Eigen::MatrixXd& right, const int* place, const Solve& solve) {
  const Eigen::Index rows = right.rows();
  Eigen::MatrixXd out(rows, right.cols());
  std::vector<double> panel;
  for (Eigen::Index first = 0; first < right.cols();) {
    const Eigen::Index left = right.cols() - first, wide = left > 4 ? 8 : 4;
    const Eigen::Index count = std::min(wide, left);
    panel.assign(static_cast<std::size_t>(rows * wide), 0.0);
    const auto at = [&](Eigen::Index i, Eigen::Index c) -> double& {
      return panel[static_cast<std::size_t>((place ? place[i] : i) * wide + c)];
    };
    for (Eigen::Index c = 0; c < count; ++c) {
      for (Eigen::Index i = 0; i < rows; ++i) at(i, c) = right(i, first + c);
    }
    solve(wide, panel.data());
    for (Eigen::Index c = 0; c < count; ++c) {
      for (Eigen::Index i = 0; i < rows; ++i) out(i, first + c) = at(i, c);
    }
    first += count;
  }
  return out;
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
  const BandFactor factor{factor_.size(), factor_.band(), factor_.column(0)};
  Eigen::Index first = 0;
  while (first < right.rows() && right.row(first).isZero(0.0)) ++first;
  return by_panels(right, nullptr, [&](Eigen::Index wide, double* x) {
    wide == 8 ? solve_eight(factor, first, x) : solve_four(factor, first, x);
  });
}

Eigen::VectorXd BandedLdlt::solve_vector(const Eigen::VectorXd& right) const {
  Eigen::VectorXd out = right;
  solve_one({factor_.size(), factor_.band(), factor_.column(0)}, 0, out.data());
  return out;
}

double BandedLdlt::log_determinant() const {
  double sum = 0.0;
  for (Eigen::Index j = 0; j < factor_.size(); ++j) sum += std::log(*factor_.column(j));
  return sum;
}

SymmetricBand BandedLdlt::inverse_in_band() const {
  const Eigen::Index size = factor_.size(), band = factor_.band();
  SymmetricBand out(size, band);
  for (Eigen::Index j = size - 1; j >= 0; --j) {
    const double* const l = factor_.column(j);
    const Eigen::Index last = std::min(size - 1, j + band);
    for (Eigen::Index i = last; i > j; --i) {
      double sum = 0.0;
      for (Eigen::Index k = j + 1; k <= last; ++k) {
        sum += l[k - j] * out.at(std::max(i, k), std::min(i, k));
      }
      out.at(i, j) = -sum;
    }
    double own = 1.0 / l[0];
    for (Eigen::Index k = j + 1; k <= last; ++k) own -= l[k - j] * out.at(k, j);
    out.at(j, j) = own;
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
  return by_panels(right, factor_.permutationP().indices().data(),
                   [&](Eigen::Index wide, double* x) {
                     wide == 8 ? solve_eight(factor, x) : solve_four(factor, x);
                   });
}

}  // namespace camber::detail
