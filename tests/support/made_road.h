#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "camber/road/road_posterior.h"

namespace camber::test {

/// A level road's field, its points known to `sigma(u)` in inverse depth; its one shared parameter
/// lengthens all depths alike.
template <typename Sigma>
std::shared_ptr<const GroundField> level_field(const PinholeCamera& camera, double height,
                                               const Sigma& sigma) {
  GroundObservations observations;
  std::vector<float> shared;
  for (int v = static_cast<int>(camera.cy) + 4; v < camera.height; v += 2) {
    const double rho = (v - camera.cy) / camera.fy / height;
    if (rho < 1.0 / 50.0) continue;
    for (int u = 0; u < camera.width; u += 4) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back(rho);
      observations.sigma.push_back(sigma(u));
      shared.push_back(static_cast<float>(rho));
    }
  }
  observations.shared_jacobian =
      Eigen::Map<const Eigen::VectorXf>(shared.data(), static_cast<Eigen::Index>(shared.size()));
  return std::make_shared<GroundField>(camera, observations, Plane{{0, -1, 0}, height},
                                       GroundFieldOptions());
}

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
