#include "camber/scale/known_poses_constraint.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace camber {

Constraint known_poses_constraint(const RoadPosterior& road, double metres_per_baseline,
                                  double relative_sigma) {
  if (!(metres_per_baseline > 0.0) || !(relative_sigma > 0.0)) {
    throw std::invalid_argument(fmt::format("known poses: {} m +- {}, both must be > 0",
                                            metres_per_baseline, relative_sigma));
  }
  Constraint out;
  out.name = "known_poses";
  out.source = fmt::format("longest baseline {:.3f} m +- {:.2f} %", metres_per_baseline,
                           100.0 * relative_sigma);
  out.by_log_scale = Eigen::VectorXd::Ones(1);
  out.residual =
      Eigen::VectorXd::Constant(1, std::log(metres_per_baseline / road.metres_per_baseline()));
  out.covariance = Eigen::MatrixXd::Constant(1, 1, relative_sigma * relative_sigma);
  return out;
}

}  // namespace camber
