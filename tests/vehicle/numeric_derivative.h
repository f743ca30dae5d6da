#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <functional>

#include "camber/vehicle/detail/vehicle_state.h"

namespace camber::test {

/// Central differences of f at 0 by the rule of Ridders in two steps: h and h / 2, extrapolated, so
/// that the error is of the order h^4 and rounding about 1e-16 |f| / h.
inline Eigen::MatrixXd numeric_jacobian(
    const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& f, Eigen::Index parameters,
    double h = 1e-4) {
  Eigen::MatrixXd out;
  for (Eigen::Index i = 0; i < parameters; ++i) {
    const auto difference = [&](double step) {
      Eigen::VectorXd x = Eigen::VectorXd::Zero(parameters);
      x[i] = step;
      const Eigen::VectorXd ahead = f(x);
      x[i] = -step;
      return Eigen::VectorXd((ahead - f(x)) / (2.0 * step));
    };
    const Eigen::VectorXd coarse = difference(h), fine = difference(0.5 * h);
    if (i == 0) out.resize(coarse.size(), parameters);
    out.col(i) = (4.0 * fine - coarse) / 3.0;
  }
  return out;
}

inline Eigen::VectorXd numeric_gradient(const std::function<double(const Eigen::VectorXd&)>& f,
                                        Eigen::Index parameters, double h = 1e-4) {
  return numeric_jacobian(
             [&](const Eigen::VectorXd& x) { return Eigen::VectorXd::Constant(1, f(x)); },
             parameters, h)
      .transpose();
}

/// Entries agree within `relative` of each numeric one and of the largest of its row.
inline void expect_same_derivatives(const Eigen::MatrixXd& written, const Eigen::MatrixXd& numeric,
                                    double relative, const std::string& what) {
  ASSERT_EQ(written.rows(), numeric.rows()) << what;
  ASSERT_EQ(written.cols(), numeric.cols()) << what;
  for (Eigen::Index r = 0; r < numeric.rows(); ++r) {
    const double most = numeric.row(r).cwiseAbs().maxCoeff();
    for (Eigen::Index c = 0; c < numeric.cols(); ++c) {
      EXPECT_NEAR(written(r, c), numeric(r, c), relative * most + 1e-12)
          << what << ": row " << r << ", column " << c << ", largest of the row " << most;
    }
  }
}

}  // namespace camber::test
