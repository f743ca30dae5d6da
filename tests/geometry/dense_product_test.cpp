// Against Eigen's products, for sizes around those of the tiles.

#include "camber/geometry/detail/dense_product.h"

#include <gtest/gtest.h>

#include <tuple>

#include "camber/core/random.h"

namespace camber::detail {
namespace {

Eigen::MatrixXd drawn(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  const CounterRandom random(seed);
  Eigen::MatrixXd out(rows, columns);
  for (Eigen::Index i = 0; i < out.size(); ++i) {
    out(i) = random.uniform(static_cast<std::uint64_t>(i), -1.0, 1.0);
  }
  return out;
}

TEST(DenseProduct, IsTheProduct) {
  for (const auto& [rows, inner, columns] : {std::tuple{1, 1, 1},
                                             {8, 5, 4},
                                             {9, 30, 7},
                                             {17, 3, 13},
                                             {3, 40, 1},
                                             {0, 3, 2},
                                             {2, 0, 3}}) {
    const Eigen::MatrixXd a = drawn(rows, inner, 1), b = drawn(inner, columns, 2);
    EXPECT_TRUE(product(a, b).isApprox(a * b, 1e-13) || a.size() * b.size() == 0);
    EXPECT_EQ(product(a, b).rows(), rows);
    const Eigen::MatrixXd turned = a.transpose();
    EXPECT_EQ(transposed_product(turned, b), product(a, b));
  }
}

TEST(DenseProduct, ASquareIsSymmetric) {
  for (const int rows : {1, 7, 8, 21}) {
    const Eigen::MatrixXd a = drawn(rows, 30, 3), found = square(a);
    EXPECT_TRUE(found.isApprox(a * a.transpose(), 1e-13)) << rows;
    EXPECT_EQ(found, found.transpose());
  }
}

}  // namespace
}  // namespace camber::detail
