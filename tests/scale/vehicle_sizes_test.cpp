// The scale by the sizes of several vehicles.

#include "camber/scale/vehicle_sizes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "camber/scale/fusion.h"
#include "camber/scale/known_poses_constraint.h"
#include "scale/open_road.h"

namespace camber {
namespace {

using namespace test;

/// A road whose scale is known to `sigma`.
RoadPosterior road_of_scale(double sigma) {
  const RoadPosterior open = open_road();
  return open.conditioned(known_poses_constraint(open, 1.0, sigma));
}

std::vector<Constraint> vehicles_at(const RoadPosterior& road, const std::vector<double>& scales,
                                    double sigma) {
  std::vector<Constraint> out;
  double u = 100.0;
  for (const double scale : scales)
    out.push_back(known_length(road, {u += 60.0, 250}, scale, sigma));
  return out;
}

TEST(VehicleSizes, AgreeWithARightScale) {
  const RoadPosterior road = road_of_scale(0.01);
  const ScaleNoise noise;
  const auto sizes =
      compare_vehicle_sizes(road, vehicles_at(road, {0.04, -0.05, 0.01, 0.0}, 0.05), noise);
  ASSERT_TRUE(sizes);
  EXPECT_EQ(sizes->vehicles, 4);
  EXPECT_NEAR(sizes->log_scale, 0.0, 0.01);
  EXPECT_LT(sizes->sigmas_off, 1.0);
  // Four are better than one, but never better than cars of a street are alike.
  EXPECT_LT(sizes->sigma, 0.05);
  EXPECT_GT(sizes->sigma, noise.compared_population);
}

TEST(VehicleSizes, ContradictAScaleThatIsWrong) {
  const RoadPosterior road = road_of_scale(0.01);
  const auto sizes =
      compare_vehicle_sizes(road, vehicles_at(road, {0.3, 0.34, 0.27, 0.31, 0.29}, 0.05), {});
  ASSERT_TRUE(sizes);
  EXPECT_NEAR(sizes->log_scale, 0.30, 0.02);
  EXPECT_GT(sizes->sigmas_off, ScaleNoise().vehicle_sizes_gate);
  // The worse the scale is known, the less they contradict it.
  const auto less = compare_vehicle_sizes(
      road_of_scale(0.1), vehicles_at(road, {0.3, 0.34, 0.27, 0.31, 0.29}, 0.05), {});
  ASSERT_TRUE(less);
  EXPECT_LT(less->sigmas_off, sizes->sigmas_off - 1.0);
}

TEST(VehicleSizes, ThreeUncertainCarsContradictAScaleThatIsASixthTooLarge) {
  const RoadPosterior road = road_of_scale(0.02);
  const auto sizes = compare_vehicle_sizes(road, vehicles_at(road, {-0.1, -0.2, -0.15}, 0.1), {});
  ASSERT_TRUE(sizes);
  EXPECT_GT(sizes->sigmas_off, ScaleNoise().vehicle_sizes_gate);
}

TEST(VehicleSizes, OneVanAmongCarsNeitherDecidesNorHidesThem) {
  const RoadPosterior road = road_of_scale(0.01);
  const auto right =
      compare_vehicle_sizes(road, vehicles_at(road, {0.0, 0.02, 0.5, -0.02, 0.01}, 0.05), {});
  ASSERT_TRUE(right);
  EXPECT_NEAR(right->log_scale, 0.0, 0.03);
  EXPECT_LT(right->sigmas_off, 1.0);
  const auto wrong =
      compare_vehicle_sizes(road, vehicles_at(road, {-0.18, -0.2, 0.3, -0.16, -0.2}, 0.05), {});
  ASSERT_TRUE(wrong);
  EXPECT_NEAR(wrong->log_scale, -0.18, 0.02);
  EXPECT_GT(wrong->sigmas_off, ScaleNoise().vehicle_sizes_gate);
}

TEST(VehicleSizes, WithNormalErrorsTheRatioIsThatOfTheMean) {
  const RoadPosterior road = road_of_scale(0.01);
  ScaleNoise noise;
  noise.vehicle_size_freedom = 1e6;
  noise.vehicle_size_spread = 1.0;
  const auto sizes = compare_vehicle_sizes(road, vehicles_at(road, {0.2, 0.1, 0.15}, 0.05), noise);
  ASSERT_TRUE(sizes);
  // implied_log_scale() adds what the road leaves open of each distance.
  const auto one = implied_log_scale(road, known_length(road, {220.0, 250}, 0.1, 0.05));
  ASSERT_TRUE(one);
  const double variance = one->variance / 3.0 + std::pow(noise.compared_population, 2) +
                          std::pow(road.scale_sigma(), 2);
  EXPECT_NEAR(sizes->log_scale, 0.15, 0.002);
  EXPECT_NEAR(sizes->sigmas_off, sizes->log_scale / std::sqrt(variance), 0.05);
}

TEST(VehicleSizes, OfOneVehicleMeasureNothing) {
  const RoadPosterior road = road_of_scale(0.01);
  EXPECT_FALSE(compare_vehicle_sizes(road, vehicles_at(road, {0.3}, 0.05), {}));
  EXPECT_FALSE(compare_vehicle_sizes(road, {}, {}));
}

TEST(VehicleSizes, OfTwoVehiclesContradictAScaleThatIsFarOff) {
  const RoadPosterior road = road_of_scale(0.01);
  const auto far = compare_vehicle_sizes(road, vehicles_at(road, {0.3, 0.3}, 0.05), {});
  ASSERT_TRUE(far);
  EXPECT_GT(far->sigmas_off, ScaleNoise().vehicle_sizes_gate);
  // A car and a van.
  const auto two = compare_vehicle_sizes(road, vehicles_at(road, {0.0, 0.3}, 0.05), {});
  ASSERT_TRUE(two);
  EXPECT_LT(two->sigmas_off, ScaleNoise().vehicle_sizes_start);
}

TEST(VehicleSizes, OfUncertainVehiclesContradictHardly) {
  const RoadPosterior road = road_of_scale(0.01);
  const auto sizes = compare_vehicle_sizes(road, vehicles_at(road, {0.15, 0.15, 0.15}, 0.4), {});
  ASSERT_TRUE(sizes);
  EXPECT_GT(sizes->sigma, 0.2);
  EXPECT_LT(sizes->sigmas_off, ScaleNoise().vehicle_sizes_start);
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
