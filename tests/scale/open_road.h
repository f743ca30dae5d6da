#pragma once

#include <memory>

#include "camber/road/constraint.h"
#include "scale/profile_road.h"
#include "support/made_road.h"

namespace camber::test {

/// A level road whose scale, in truth 1, is known to `log_scale_sigma` only.
inline RoadPosterior open_road(double metres_per_baseline = 1.0, double log_scale_sigma = 1.0) {
  GroundObservations observations;
  for (int v = 160; v < kRoadCamera.height; v += 4) {
    for (int u = 0; u < kRoadCamera.width; u += 16) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back(1.0 / depth_of(v, level));
      observations.sigma.push_back(0.001);
    }
  }
  return road_posterior(
      std::make_shared<GroundField>(kRoadCamera, observations, Plane{{0, -1, 0}, kRoadHeight},
                                    GroundFieldOptions()),
      {}, kRoadHeight, metres_per_baseline, log_scale_sigma);
}

/// A length of known size that makes the distance to the ground at its pixel `log_scale` larger.
inline Constraint known_length(const RoadPosterior& road, const Eigen::Vector2d& pixel,
                               double log_scale, double sigma) {
  Constraint out;
  out.name = "length";
  out.pixels = {pixel};
  out.by_inverse_depth = Eigen::MatrixXd::Constant(1, 1, -1.0 / road.inverse_depth(pixel));
  out.residual = Eigen::VectorXd::Constant(1, log_scale);
  out.covariance = Eigen::MatrixXd::Constant(1, 1, sigma * sigma);
  return out;
}

}  // namespace camber::test
