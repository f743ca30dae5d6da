#include "camber/scale/passing_road_constraint.h"

#include <fmt/format.h>

#include <cmath>

namespace camber {

Constraint passing_road_constraint(const RoadPosterior& road, double log_baseline) {
  const double height = road.ego().plane.offset;
  Constraint out;
  out.name = "passing_road";
  out.source = fmt::format("what passes on the road: a baseline is {:.3f} camera heights",
                           std::exp(log_baseline));
  // A plane that is raised towards the camera lowers the camera's height above it.
  out.by_ego = Eigen::RowVector3d(0.0, 0.0, -1.0 / height);
  out.by_log_scale = Eigen::VectorXd::Constant(1, -1.0);
  out.residual =
      Eigen::VectorXd::Constant(1, -log_baseline - std::log(height / road.metres_per_baseline()));
  out.covariance = Eigen::MatrixXd::Constant(1, 1, kSweptHeight * kSweptHeight);
  return out;
}

}  // namespace camber
