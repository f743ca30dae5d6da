#include "camber/geometry/detail/dense_product.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

#include "camber/core/target_clones.h"

namespace camber::detail {
namespace {

constexpr std::ptrdiff_t kHigh = 8, kWide = 4;  // of a tile of the result
using D4 = double __attribute__((vector_size(32)));

/// A tile of a product in registers, all of the inner dimension at once.
/// @param a    kHigh rows: kHigh values an inner place
/// @param b    kWide columns: kWide values an inner place
/// @param out  kHigh x kWide, column by column
CAMBER_TARGET_CLONES("avx2")
void multiply_tile(std::ptrdiff_t inner, const double* a, const double* b, double* out) {
  D4 upper[kWide] = {}, lower[kWide] = {};
  for (std::ptrdiff_t k = 0; k < inner; ++k) {
    D4 top, bottom;
    std::memcpy(&top, a + k * kHigh, sizeof(D4));
    std::memcpy(&bottom, a + k * kHigh + 4, sizeof(D4));
    for (int c = 0; c < kWide; ++c) {
      const double value = b[k * kWide + c];
      upper[c] += top * value;
      lower[c] += bottom * value;
    }
  }
  for (int c = 0; c < kWide; ++c) {
    std::memcpy(out + c * kHigh, &upper[c], sizeof(D4));
    std::memcpy(out + c * kHigh + 4, &lower[c], sizeof(D4));
  }
}

/// Slices of `wide` rows of a matrix, each inner place by inner place, filled up with zeros.
template <class Matrix>
std::vector<double> sliced(const Matrix& matrix, std::ptrdiff_t wide) {
  const std::ptrdiff_t rows = matrix.rows(), inner = matrix.cols();
  std::vector<double> out(static_cast<std::size_t>((rows + wide - 1) / wide * wide * inner), 0.0);
  for (std::ptrdiff_t first = 0; first < rows; first += wide) {
    double* to = out.data() + first * inner;
    const std::ptrdiff_t count = std::min(wide, rows - first);
    for (std::ptrdiff_t k = 0; k < inner; ++k) {
      for (std::ptrdiff_t r = 0; r < count; ++r) to[k * wide + r] = matrix(first + r, k);
    }
  }
  return out;
}

/// a * b from slices of a's rows and of b's columns.
/// @param symmetric  the lower triangle is computed and mirrored
Eigen::MatrixXd multiplied(std::ptrdiff_t rows, std::ptrdiff_t columns, std::ptrdiff_t inner,
                           const std::vector<double>& a, const std::vector<double>& b,
                           bool symmetric) {
  Eigen::MatrixXd out(rows, columns);
  double tile[kHigh * kWide];
  for (std::ptrdiff_t c = 0; c < columns; c += kWide) {
    for (std::ptrdiff_t r = 0; r < rows; r += kHigh) {
      if (symmetric && r + kHigh <= c) continue;
      multiply_tile(inner, a.data() + r * inner, b.data() + c * inner, tile);
      for (std::ptrdiff_t j = c; j < std::min(c + kWide, columns); ++j) {
        for (std::ptrdiff_t i = r; i < std::min(r + kHigh, rows); ++i) {
          out(i, j) = tile[(j - c) * kHigh + i - r];
        }
      }
    }
  }
  if (symmetric) out.triangularView<Eigen::StrictlyUpper>() = out.transpose();
  return out;
}

}  // namespace

Eigen::MatrixXd product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                        const Eigen::Ref<const Eigen::MatrixXd>& b) {
  return multiplied(a.rows(), b.cols(), a.cols(), sliced(a, kHigh), sliced(b.transpose(), kWide),
                    false);
}

Eigen::MatrixXd transposed_product(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                   const Eigen::Ref<const Eigen::MatrixXd>& b) {
  return multiplied(a.cols(), b.cols(), a.rows(), sliced(a.transpose(), kHigh),
                    sliced(b.transpose(), kWide), false);
}

Eigen::MatrixXd square(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  return multiplied(a.rows(), a.rows(), a.cols(), sliced(a, kHigh), sliced(a, kWide), true);
}

}  // namespace camber::detail
