#include "camber/scale/speed_constraint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "camber/scale/fusion.h"
#include "camber/scale/known_poses_constraint.h"
#include "scale/open_road.h"

namespace camber {
namespace {

using namespace test;

TEST(Speed, GivesTheScaleWithItsSigma) {
  const RoadPosterior road = open_road(1.2);
  const auto constraint = speed_constraint(road, {2.0, 0.04}, 2.0, 2, 0.0);
  ASSERT_TRUE(constraint);
  constraint->validate();
  EXPECT_EQ(constraint->name, "speed");
  EXPECT_NEAR(constraint->covariance(0, 0), 0.02 * 0.02, 1e-15);
  const RoadPosterior known = road.conditioned(*constraint);
  // The prior is a hundred per cent wide: it holds back by 0.0004 of the difference.
  EXPECT_NEAR(std::log(known.metres_per_baseline()), 0.0, 2e-4);
  EXPECT_NEAR(known.scale_sigma(), 0.02, 1e-4);
  const auto path = speed_constraint(road, {2.0, 0.04}, 2.0, 2, 0.01);
  EXPECT_NEAR(path->covariance(0, 0), 0.02 * 0.02 + 1e-4, 1e-12);
}

TEST(Speed, IsTheDerivativeByTheScale) {
  const TravelledDistance distance{1.5, 0.03};
  const double step = 1e-5;
  const double at = speed_constraint(open_road(1.0), distance, 1.4, 1, 0.0)->residual[0];
  const double beside =
      speed_constraint(open_road(std::exp(step)), distance, 1.4, 1, 0.0)->residual[0];
  // The residual is measured less predicted.
  EXPECT_NEAR((at - beside) / step, 1.0, 1e-6);
}

TEST(Speed, ThatContradictsIsRejected) {
  const RoadPosterior road = open_road(1.0);
  const Constraint poses = known_poses_constraint(road, 1.0, 0.01);
  const auto wrong = speed_constraint(road, {3.6, 0.07}, 1.0, 1, 0.005);  // km/h for m/s
  Constraint height = known_poses_constraint(road, 1.01, 0.01);
  height.name = "height";
  const FusedRoad fused = fuse(road, {poses, height, *wrong});
  EXPECT_TRUE(fused.reports[0].accepted);
  EXPECT_FALSE(fused.reports[2].accepted);
  EXPECT_NEAR(fused.road.metres_per_baseline(), 1.005, 0.002);
}

TEST(Speed, OfAStationaryCameraIsNoConstraint) {
  const RoadPosterior road = open_road(1.0);
  EXPECT_FALSE(speed_constraint(road, {0.01, 0.01}, 1.0, 1, 0.0));
  EXPECT_FALSE(speed_constraint(road, {1.0, 0.01}, 0.0, 1, 0.0));
  EXPECT_THROW(speed_constraint(road, {1.0, 0.0}, 1.0, 1, 0.0), std::invalid_argument);
  EXPECT_THROW(speed_constraint(road, {-1.0, 0.1}, 1.0, 1, 0.0), std::invalid_argument);
  EXPECT_THROW(speed_constraint(road, {1.0, 0.1}, 1.0, 1, -0.1), std::invalid_argument);
}

}  // namespace
}  // namespace camber
