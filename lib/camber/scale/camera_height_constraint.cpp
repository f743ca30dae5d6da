#include "camber/scale/camera_height_constraint.h"

#include <fmt/format.h>

#include <stdexcept>

namespace camber {

Constraint camera_height_constraint(const RoadPosterior& road, double height, double sigma) {
  if (!(height > 0.0) || !(sigma > 0.0)) {
    throw std::invalid_argument(
        fmt::format("camera height: {} +- {} m, both must be > 0", height, sigma));
  }
  Constraint out;
  out.name = "camera_height";
  out.source = fmt::format("{:.3f} +- {:.3f} m above the ego plane", height, sigma);
  // A plane that is raised towards the camera lowers the camera's height above it.
  out.by_ego = Eigen::RowVector3d(0.0, 0.0, -1.0);
  out.residual = Eigen::VectorXd::Constant(1, height - road.ego().plane.offset);
  out.covariance = Eigen::MatrixXd::Constant(1, 1, sigma * sigma);
  out.common = {{"camera_height", Eigen::VectorXd::Constant(1, sigma)}};
  return out;
}

}  // namespace camber
