#pragma once

// Inside of the pipeline, not installed interface.

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace camber::internal {

/// Statements on metric inverse depths, linear around where they are taken.
struct StatementStack {
  Eigen::MatrixXd by_field;  // a row a statement
  Eigen::VectorXd missing;   // wanted minus present
  Eigen::MatrixXd noise;
};

/// Iterated Kalman update of inverse depths; stops where a step would leave a quarter of one.
/// @param stack  gives the statements around an x.
template <class Stack>
void iterated_update(const Eigen::VectorXd& start, const Eigen::MatrixXd& prior, const Stack& stack,
                     Eigen::VectorXd* x, Eigen::MatrixXd* covariance) {
  *x = start;
  *covariance = prior;
  for (int iteration = 0; iteration < 5; ++iteration) {
    const StatementStack s = stack(*x);
    if (s.missing.size() == 0) return;
    const Eigen::MatrixXd side = prior * s.by_field.transpose();
    const Eigen::LDLT<Eigen::MatrixXd> inner(s.by_field * side + s.noise);
    const Eigen::VectorXd next = start + side * inner.solve(s.missing + s.by_field * (*x - start));
    *covariance = prior - side * inner.solve(side.transpose());
    if (!next.allFinite() || !((next.array() / start.array()).minCoeff() > 0.25)) return;
    *x = next;
  }
}

}  // namespace camber::internal
