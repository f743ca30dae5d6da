#include "camber/vehicle/detail/levenberg_marquardt.h"

#include <algorithm>
#include <cmath>

#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

double refine(const VehiclePosterior& posterior, VehicleState* state, int max_iterations,
              double tolerance) {
  constexpr double kFirstDamping = 1e-3, kLeastDamping = 1e-8, kMostDamping = 1e8;
  constexpr double kAcceptedFactor = 0.2, kRejectedFactor = 8.0;
  PosteriorEquations equations;
  double cost = posterior.evaluate(*state, &equations);
  double damping = kFirstDamping;
  SymmetricFactors factors;
  Eigen::MatrixXd damped;
  for (int i = 0; i < max_iterations && std::isfinite(cost); ++i) {
    damped = equations.hessian;
    damped.diagonal() *= 1.0 + damping;
    factors.compute(damped);
    const Eigen::VectorXd step = posterior.limited(-factors.solve(equations.gradient));
    VehicleState candidate = posterior.moved(*state, step);
    if (posterior.num_views() > 1) {
      candidate.errors.reshaped() -= equations.errors_at + equations.errors_by * step;
    }
    const double next = posterior.evaluate(candidate, nullptr);
    if (next < cost) {
      const double gain = cost - next;
      *state = std::move(candidate);
      cost = next;
      damping = std::max(damping * kAcceptedFactor, kLeastDamping);
      if (gain < tolerance) break;
      posterior.evaluate(*state, &equations);
    } else {
      damping *= kRejectedFactor;
      if (damping > kMostDamping) break;
    }
  }
  return cost;
}

}  // namespace camber::internal
