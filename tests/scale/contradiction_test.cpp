// Sources that contradict the scale of a result.

#include "camber/scale/contradiction.h"

#include <gtest/gtest.h>

#include <memory>

#include "scale/profile_road.h"
#include "support/made_road.h"

namespace camber {
namespace {

using namespace test;

/// A level road, its scale open.
RoadPosterior open_road(double scale_sigma = 1.0) {
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
      {}, kRoadHeight, 1.0, scale_sigma);
}

/// A known length on the road that makes everything `log_scale` larger.
Constraint length(const RoadPosterior& road, const Eigen::Vector2d& pixel, double log_scale,
                  double sigma) {
  Constraint out;
  out.name = "length";
  out.pixels = {pixel};
  out.by_inverse_depth = Eigen::MatrixXd::Constant(1, 1, -1.0 / road.inverse_depth(pixel));
  out.residual = Eigen::VectorXd::Constant(1, log_scale);
  out.covariance = Eigen::MatrixXd::Constant(1, 1, sigma * sigma);
  out.gate = 3.0;
  return out;
}

ConstraintReport off_by(double sigmas) { return {"length", "", sigmas, sigmas <= 3.0, ""}; }

TEST(ContradictingScale, AddsAShareOfTheSquaredDifference) {
  const RoadPosterior road = open_road();
  const Constraint source = length(road, {320, 250}, -0.3, 0.1);
  const ScaleNoise noise;
  EXPECT_FALSE(contradicting_scale(road, source, off_by(1.9), 0.01, noise));
  const auto half = contradicting_scale(road, source, off_by(2.5), 0.01, noise);
  ASSERT_TRUE(half);
  EXPECT_NEAR(half->log_scale, -0.31, 1e-3);
  EXPECT_NEAR(half->variance, 0.5 * 0.31 * 0.31, 1e-3);
  const auto all = contradicting_scale(road, source, off_by(7.0), 0.01, noise);
  ASSERT_TRUE(all);
  EXPECT_NEAR(all->variance, 0.31 * 0.31, 1e-3);
}

TEST(ContradictingScale, ASourceThatHardlyKnowsTheScaleContradictsNone) {
  const RoadPosterior road = open_road();
  const ScaleNoise noise;
  EXPECT_TRUE(
      contradicting_scale(road, length(road, {320, 250}, 0.8, 0.25), off_by(3.1), 0, noise));
  EXPECT_FALSE(
      contradicting_scale(road, length(road, {320, 250}, 4.5, 1.9), off_by(2.3), 0, noise));
  // What the road's own scale leaves open is not the source's.
  const RoadPosterior wider = open_road(3.0);
  EXPECT_TRUE(
      contradicting_scale(wider, length(wider, {320, 250}, 0.8, 0.25), off_by(3.1), 0, noise));
}

}  // namespace
}  // namespace camber
