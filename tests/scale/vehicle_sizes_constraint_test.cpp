// The scale by the sizes of several vehicles.

#include "camber/scale/vehicle_sizes_constraint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "camber/scale/known_poses_constraint.h"
#include "scale/profile_road.h"
#include "support/made_road.h"

namespace camber {
namespace {

using namespace test;

/// A road whose scale is known to `sigma`.
RoadPosterior road_of_scale(double sigma) {
  GroundObservations observations;
  for (int v = 160; v < kRoadCamera.height; v += 4) {
    for (int u = 0; u < kRoadCamera.width; u += 16) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back(1.0 / depth_of(v, level));
      observations.sigma.push_back(0.001);
    }
  }
  const RoadPosterior open = road_posterior(
      std::make_shared<GroundField>(kRoadCamera, observations, Plane{{0, -1, 0}, kRoadHeight},
                                    GroundFieldOptions()),
      {}, kRoadHeight, 1.0, 1.0);
  return open.conditioned(known_poses_constraint(open, 1.0, sigma));
}

/// A vehicle whose size makes the distance to the ground at its pixel `log_scale` larger.
Constraint vehicle_at(const RoadPosterior& road, const Eigen::Vector2d& pixel, double log_scale,
                      double sigma) {
  Constraint out;
  out.name = "vehicle";
  out.pixels = {pixel};
  const double rho = road.inverse_depth(pixel);
  out.by_inverse_depth = Eigen::MatrixXd::Constant(1, 1, -1.0 / rho);  // of the log distance
  out.residual = Eigen::VectorXd::Constant(1, log_scale);
  out.covariance = Eigen::MatrixXd::Constant(1, 1, sigma * sigma);
  return out;
}

std::vector<Constraint> vehicles_at(const RoadPosterior& road, const std::vector<double>& scales,
                                    double sigma) {
  std::vector<Constraint> out;
  double u = 100.0;
  for (const double scale : scales) out.push_back(vehicle_at(road, {u += 60.0, 250}, scale, sigma));
  return out;
}

double sigmas_off(const RoadPosterior& road, const Constraint& sizes) {
  return std::sqrt(road.squared_innovation(sizes));
}

TEST(VehicleSizes, AgreeWithARightScale) {
  const RoadPosterior road = road_of_scale(0.01);
  const ScaleNoise noise;
  const Constraint sizes =
      vehicle_sizes_constraint(road, vehicles_at(road, {0.04, -0.05, 0.01, 0.0}, 0.05), noise);
  ASSERT_EQ(sizes.size(), 1);
  EXPECT_EQ(sizes.name, "vehicle_sizes");
  EXPECT_EQ(sizes.source, "4 vehicles");
  EXPECT_NEAR(sizes.residual[0], 0.0, 0.01);
  EXPECT_LT(sigmas_off(road, sizes), 1.0);
  // Four are better than one, but never better than cars of a street are alike.
  EXPECT_LT(sizes.covariance(0, 0), 0.05 * 0.05);
  EXPECT_GT(sizes.covariance(0, 0), noise.vehicle_population * noise.vehicle_population);
}

TEST(VehicleSizes, ContradictAScaleThatIsWrong) {
  const RoadPosterior road = road_of_scale(0.01);
  const std::vector<Constraint> vehicles = vehicles_at(road, {0.3, 0.34, 0.27, 0.31, 0.29}, 0.05);
  const Constraint sizes = vehicle_sizes_constraint(road, vehicles, {});
  ASSERT_EQ(sizes.size(), 1);
  EXPECT_NEAR(sizes.residual[0], 0.30, 0.02);
  EXPECT_GT(sigmas_off(road, sizes), sizes.gate);
}

TEST(VehicleSizes, OneVanAmongCarsDoesNotDecide) {
  const RoadPosterior road = road_of_scale(0.01);
  const Constraint sizes =
      vehicle_sizes_constraint(road, vehicles_at(road, {0.0, 0.02, 0.5, -0.02, 0.01}, 0.05), {});
  ASSERT_EQ(sizes.size(), 1);
  EXPECT_NEAR(sizes.residual[0], 0.0, 0.03);
  EXPECT_LT(sigmas_off(road, sizes), 2.0);
}

TEST(VehicleSizes, OfFewOrUncertainVehiclesMeasureNothing) {
  const RoadPosterior road = road_of_scale(0.01);
  EXPECT_EQ(vehicle_sizes_constraint(road, vehicles_at(road, {0.3, 0.3}, 0.05), {}).size(), 0);
  EXPECT_EQ(vehicle_sizes_constraint(road, vehicles_at(road, {0.3, 0.3, 0.3}, 0.4), {}).size(), 0);
  EXPECT_EQ(vehicle_sizes_constraint(road, {}, {}).size(), 0);
}

TEST(RoadPosterior, AWiderScaleWidensWhatDependsOnIt) {
  const RoadPosterior road = road_of_scale(0.01), wide = road.with_wider_scale(0.3 * 0.3);
  EXPECT_NEAR(wide.scale_sigma(), std::hypot(0.01, 0.3), 1e-6);
  EXPECT_EQ(wide.metres_per_baseline(), road.metres_per_baseline());
  const double before = road.ego().covariance(2, 2), after = wide.ego().covariance(2, 2);
  EXPECT_NEAR(after - before, std::pow(0.3 * kRoadHeight, 2), 1e-3 * after);
  EXPECT_NEAR(wide.ego().covariance(0, 0), road.ego().covariance(0, 0), 1e-12);
}

}  // namespace
}  // namespace camber
