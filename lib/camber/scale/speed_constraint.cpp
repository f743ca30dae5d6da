#include "camber/scale/speed_constraint.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace camber {

std::optional<Constraint> speed_constraint(const RoadPosterior& road,
                                           const std::vector<TravelledDistance>& distances,
                                           const std::vector<double>& baselines, double correlation,
                                           double path_sigma) {
  if (distances.size() != baselines.size()) {
    throw std::invalid_argument(
        fmt::format("speed: {} distances and {} baselines, expected as many", distances.size(),
                    baselines.size()));
  }
  if (!(correlation >= 0.0 && correlation <= 1.0) || !(path_sigma >= 0.0)) {
    throw std::invalid_argument(
        fmt::format("speed: correlation {} and path sigma {}, expected from 0 to 1 and at least 0",
                    correlation, path_sigma));
  }
  double metres = 0.0, length = 0.0, sum = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < distances.size(); ++k) {
    const TravelledDistance& d = distances[k];
    if (!(d.metres >= 0.0) || !(d.sigma > 0.0) || !(baselines[k] >= 0.0)) {
      throw std::invalid_argument(
          fmt::format("speed: {} m +- {} over {} baselines, expected none below 0", d.metres,
                      d.sigma, baselines[k]));
    }
    metres += d.metres;
    length += baselines[k];
    sum += d.sigma;
    squares += d.sigma * d.sigma;
  }
  const double sigma = std::sqrt(correlation * sum * sum + (1.0 - correlation) * squares);
  if (!(length > 0.0) || !(metres > 3.0 * sigma)) return std::nullopt;
  const double relative = std::hypot(sigma / metres, path_sigma);
  Constraint out;
  out.name = "speed";
  out.source = fmt::format("{:.3f} m +- {:.2f} % over {} frames", metres, 100.0 * relative,
                           distances.size() + 1);
  out.by_log_scale = Eigen::VectorXd::Ones(1);
  out.residual =
      Eigen::VectorXd::Constant(1, std::log(metres / (length * road.metres_per_baseline())));
  out.covariance = Eigen::MatrixXd::Constant(1, 1, relative * relative);
  return out;
}

}  // namespace camber
