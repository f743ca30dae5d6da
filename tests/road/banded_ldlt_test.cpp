// Both factorisations against a dense one.

#include "camber/road/detail/banded_ldlt.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "camber/core/random.h"

namespace camber::detail {
namespace {

struct Example {
  SymmetricBand band;
  Eigen::MatrixXd dense, right;
};

/// Positive definite by its diagonal; a third of the band is zero.
Example example(Eigen::Index size, Eigen::Index reach, Eigen::Index columns) {
  const CounterRandom random(3);
  Example out{SymmetricBand(size, reach), Eigen::MatrixXd::Zero(size, size),
              Eigen::MatrixXd(size, columns)};
  std::uint64_t draw = 0;
  for (Eigen::Index j = 0; j < size; ++j) {
    for (Eigen::Index i = j; i <= std::min(size - 1, j + out.band.band()); ++i) {
      const double value = i == j          ? 4.0 * static_cast<double>(reach + 1)
                           : draw % 3 == 0 ? 0.0
                                           : random.uniform(draw, -1.0, 1.0);
      ++draw;
      out.band.at(i, j) = out.dense(i, j) = out.dense(j, i) = value;
    }
    for (Eigen::Index c = 0; c < columns; ++c) {
      out.right(j, c) = j < size / 3 ? 0.0 : random.uniform(100000 + draw++, -1.0, 1.0);
    }
  }
  return out;
}

TEST(BandedLdlt, SolvesAsADenseMatrix) {
  for (const Eigen::Index size : {1, 2, 7, 60}) {
    for (const Eigen::Index columns : {1, 8, 11}) {
      const Example e = example(size, 9, columns);
      const Eigen::MatrixXd expected = e.dense.ldlt().solve(e.right);
      BandedLdlt banded;
      ASSERT_TRUE(banded.factorise(e.band));
      EXPECT_LT((banded.solve(e.right) - expected).norm(), 1e-12) << size << " " << columns;
      EXPECT_LT((banded.solve_vector(e.right.col(0)) - expected.col(0)).norm(), 1e-12) << size;
      EXPECT_LT((SparseLdlt(e.band).solve(e.right) - expected).norm(), 1e-12)
          << size << " " << columns;
    }
  }
}

TEST(BandedLdlt, DeterminantAndInverseAsOfADenseMatrix) {
  for (const Eigen::Index size : {1, 2, 7, 60}) {
    const Example e = example(size, 9, 1);
    BandedLdlt banded;
    ASSERT_TRUE(banded.factorise(e.band));
    EXPECT_NEAR(banded.log_determinant(), e.dense.ldlt().vectorD().array().log().sum(), 1e-10);
    const Eigen::MatrixXd inverse = e.dense.inverse();
    const SymmetricBand found = banded.inverse_in_band();
    for (Eigen::Index j = 0; j < size; ++j) {
      for (Eigen::Index i = j; i <= std::min(size - 1, j + found.band()); ++i) {
        EXPECT_NEAR(found.at(i, j), inverse(i, j), 1e-13) << i << " " << j;
      }
    }
  }
}

TEST(BandedLdlt, AColumnIsTheSameBesideOthers) {
  const Example e = example(60, 9, 11);
  BandedLdlt banded;
  ASSERT_TRUE(banded.factorise(e.band));
  const SparseLdlt sparse(e.band);
  EXPECT_EQ(banded.solve(e.right).col(9), banded.solve(e.right.col(9)).col(0));
  EXPECT_EQ(sparse.solve(e.right).col(9), sparse.solve(e.right.col(9)).col(0));
}

TEST(BandedLdlt, RefusesWhatHasNoPivot) {
  Example e = example(8, 3, 1);
  BandedLdlt banded;
  e.band.at(4, 4) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(banded.factorise(e.band));
  EXPECT_FALSE(banded.factorise(SymmetricBand(5, 2)));
}

}  // namespace
}  // namespace camber::detail
