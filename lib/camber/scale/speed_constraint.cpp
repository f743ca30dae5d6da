#include "camber/scale/speed_constraint.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace camber {

bool shows_motion(const TravelledDistance& distance) {
  constexpr double kLeast = 3.0;  // standard deviations
  return distance.metres > kLeast * distance.sigma;
}

std::optional<Constraint> speed_constraint(const RoadPosterior& road,
                                           const TravelledDistance& distance, double baselines,
                                           int stretches, double path_sigma) {
  if (!(distance.metres >= 0.0) || !(distance.sigma > 0.0) || !(baselines >= 0.0) ||
      !(path_sigma >= 0.0)) {
    throw std::invalid_argument(fmt::format(
        "speed: {} m +- {} over {} baselines +- {}, expected none below 0 and a positive sigma",
        distance.metres, distance.sigma, baselines, path_sigma));
  }
  if (!(baselines > 0.0) || !shows_motion(distance)) {
    return std::nullopt;
  }
  const double relative = std::hypot(distance.sigma / distance.metres, path_sigma);
  Constraint out;
  out.name = "speed";
  out.source = fmt::format("{:.3f} m +- {:.2f} % over {} frames", distance.metres, 100.0 * relative,
                           stretches + 1);
  out.by_log_scale = Eigen::VectorXd::Ones(1);
  out.residual = Eigen::VectorXd::Constant(
      1, std::log(distance.metres / (baselines * road.metres_per_baseline())));
  out.covariance = Eigen::MatrixXd::Constant(1, 1, relative * relative);
  if (distance.common > 0.0) {
    out.common = {{"speed", Eigen::VectorXd::Constant(1, distance.common / distance.metres)}};
  }
  return out;
}

}  // namespace camber
