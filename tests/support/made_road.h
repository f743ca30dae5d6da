#pragma once

#include <memory>
#include <utility>

#include "camber/road/road_posterior.h"

namespace camber::test {

/// A road from a field, whose ego plane is level, `height` below the camera (up to scale) and known
/// to 0.2 % of that and 2 mrad.
inline RoadPosterior road_posterior(std::shared_ptr<const GroundField> field,
                                    Eigen::MatrixXd shared_covariance, double height,
                                    double metres_per_baseline, double log_scale_sigma) {
  EgoPlaneEstimate ego;
  ego.plane.plane = {{0.0, -1.0, 0.0}, height};
  ego.plane.centroid = {0.0, height, 0.0};
  UncertainPlane::make_axes({0.0, -1.0, 0.0}, {0.0, 0.0, 1.0}, &ego.plane.axis1, &ego.plane.axis2);
  ego.plane.covariance = Eigen::Vector3d(4e-6, 4e-6, 4e-6 * height * height).asDiagonal();
  return {std::move(field), std::move(shared_covariance), 4.0, ego, metres_per_baseline,
          log_scale_sigma};
}

}  // namespace camber::test
