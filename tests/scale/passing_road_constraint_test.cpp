#include "camber/scale/passing_road_constraint.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/scale/camera_height_constraint.h"
#include "scale/open_road.h"

namespace camber {
namespace {

using namespace test;

double log_height(const RoadPosterior& road) {
  return std::log(road.ego().plane.offset / road.metres_per_baseline());
}

TEST(PassingRoad, MeasuresTheCamerasHeightInBaselinesWhateverTheScale) {
  const double log_baseline = -std::log(1.1 * kRoadHeight);
  for (const double metres : {0.5, 1.0, 3.0}) {
    const RoadPosterior road = open_road(metres);
    const Constraint constraint = passing_road_constraint(road, log_baseline);
    constraint.validate();
    EXPECT_EQ(constraint.name, "passing_road");
    EXPECT_NEAR(constraint.residual[0], std::log(1.1), 1e-9) << metres;
    // The scale, which is open, does not count.
    EXPECT_LT(road.covariance(road.of_constraint(constraint))(0, 0), 0.01 * 0.01) << metres;
  }
}

TEST(PassingRoad, SharesWithTheEgoPlaneByTheirVariances) {
  const RoadPosterior road = open_road(1.0, 1.0);
  const double before = log_height(road);
  const Constraint constraint = passing_road_constraint(road, -before - 0.01);
  const double own = road.covariance(road.of_constraint(constraint))(0, 0);
  const RoadPosterior known = road.conditioned(constraint);
  EXPECT_NEAR(log_height(known) - before, 0.01 * own / (own + kSweptHeight * kSweptHeight), 1e-4);
  // Alone it says nothing of the metres; with the camera's height they follow.
  EXPECT_NEAR(known.scale_sigma(), road.scale_sigma(), 1e-3);
  const RoadPosterior metric =
      known.conditioned(camera_height_constraint(known, kRoadHeight, 0.001));
  EXPECT_NEAR(std::log(metric.ego().plane.offset / kRoadHeight), 0.0, 1e-3);
  EXPECT_LT(metric.scale_sigma(), 0.06);
}

}  // namespace
}  // namespace camber
