// What strokes of a line and crossings of known size measure of scale and ground.

#include "camber/scale/lane_marking_constraint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "scale/profile_road.h"
#include "support/made_road.h"

namespace camber {
namespace {

using namespace test;

const PinholeCamera& kCamera = kRoadCamera;
constexpr double kHeight = kRoadHeight;
const LaneMarkingSizes kSizes{3.0, 6.0, 0.12, 0.5, 0.5};

/// A road whose inverse depths are off by `bias` of themselves at 40 m, as the square
/// of the depth, and all lengths by `scale`.
RoadPosterior road_of(const Profile& height, double scale, double bias, double metres,
                      double sigma) {
  GroundObservations observations;
  for (int v = 110; v < kCamera.height; v += 2) {
    const double z = depth_of(v, height);
    if (z > 80.0) continue;
    for (int u = 0; u < kCamera.width; u += 4) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back((1.0 + bias * z * z / 1600.0) / (scale * z));
      observations.sigma.push_back(0.0007 / scale);
    }
  }
  return road_posterior(
      std::make_shared<GroundField>(kCamera, observations, Plane{{0, -1, 0}, kHeight * scale},
                                    GroundFieldOptions()),
      {}, kHeight * scale, metres, sigma);
}

LaneMarkingConstraint measured(const RoadPosterior& road, const LaneMarkings& markings,
                               const LaneMarkingSizes& sizes = kSizes) {
  return lane_marking_constraint(road, kCamera, markings, sizes);
}

double row_at(double z, const Profile& height) { return kCamera.cy + kCamera.fy * height(z) / z; }

/// Strokes on the ground at x = -1, as they are seen.
std::vector<PaintedDash> strokes(const std::vector<double>& starts, const Profile& height) {
  std::vector<PaintedDash> out;
  // Stations run along the ground, not along z.
  const auto depth_at = [&](double station) {
    double z = 0.0, s = 0.0;
    const double step = 0.01;
    while (s < station) {
      s += std::hypot(step, height(z + step) - height(z));
      z += step;
    }
    return z;
  };
  for (const double start : starts) {
    PaintedDash dash;
    const auto pixel = [&](double z) {
      return Eigen::Vector2d(kCamera.cx - kCamera.fx / z, row_at(z, height));
    };
    dash.near_end = pixel(depth_at(start));
    dash.far_end = pixel(depth_at(start + 3.0));
    dash.centroid = 0.5 * (dash.near_end + dash.far_end);
    dash.rows = static_cast<int>(dash.near_end.y() - dash.far_end.y());
    dash.sigma = 0.2;
    out.push_back(dash);
  }
  return out;
}

TEST(LaneMarkingConstraint, ABrokenLineGivesTheScaleAndTheFarGround) {
  for (const auto& height : {Profile(level), Profile(hill)}) {
    const RoadPosterior road = road_of(height, 1.0, 0.06, 1.0, 0.01);
    LaneMarkings markings;
    markings.dashes = strokes({8, 17, 26, 35, 44}, height);
    const Eigen::Vector2d fourth = markings.dashes[3].centroid;
    const double truth = depth_of(fourth.y(), height);
    ASSERT_LT(1.0 / road.inverse_depth(fourth), 0.97 * truth);
    const LaneMarkingConstraint found = measured(road, markings);
    EXPECT_EQ(found.reason, "");
    EXPECT_GE(found.dashes, 4);
    EXPECT_GT(found.farthest, 35.0);
    const RoadPosterior after = road.conditioned(found.constraint);
    EXPECT_LT(after.scale_sigma(), 0.01);
    EXPECT_LT(std::abs(std::log(after.metres_per_baseline())), 3.0 * after.scale_sigma());
    EXPECT_NEAR(1.0 / after.inverse_depth(fourth), truth, 0.015 * truth);
  }
}

TEST(LaneMarkingConstraint, ALineAloneGivesTheScale) {
  // The field is right up to its scale, of which nothing is known.
  const double scale = 1.3;
  const RoadPosterior road = road_of(level, 1.0 / scale, 0.0, 1.2, 0.2);
  LaneMarkings markings;
  markings.dashes = strokes({8, 17, 26}, level);
  const LaneMarkingConstraint found = measured(road, markings);
  ASSERT_GT(found.constraint.size(), 0) << found.reason;
  const RoadPosterior after = road.conditioned(found.constraint);
  EXPECT_LT(after.scale_sigma(), 0.03);
  EXPECT_NEAR(after.metres_per_baseline(), scale, 3.0 * after.scale_sigma() * scale);
}

TEST(LaneMarkingConstraint, AHiddenStrokeIsPassedOver) {
  LaneMarkings markings;
  markings.dashes = strokes({8, 26, 35}, level);
  const LaneMarkingConstraint found = measured(road_of(level, 1.0, 0.0, 1.0, 0.01), markings);
  EXPECT_EQ(found.dashes, 3) << found.reason;
}

TEST(LaneMarkingConstraint, OneBarAloneAndBarsBesideTheRoadMeasureNothing) {
  const RoadPosterior road = road_of(level, 1.0, 0.0, 1.0, 0.01);
  LaneMarkings markings;
  markings.dashes = strokes({8}, level);
  LaneMarkingConstraint found = measured(road, markings);
  EXPECT_EQ(found.constraint.size(), 0);
  EXPECT_NE(found.reason, "");
  // Two strokes 13 m apart are no line of this kind.
  markings.dashes = strokes({8, 21}, level);
  EXPECT_EQ(measured(road, markings).constraint.size(), 0);
  EXPECT_EQ(measured(road, {}).reason, "no marking of the sizes given is seen whole");
}

TEST(LaneMarkingConstraint, WrongSizesAreRejected) {
  LaneMarkings markings;
  markings.dashes = strokes({8, 17, 26}, level);
  LaneMarkingSizes wrong = kSizes;
  wrong.dash_length = 4.0;
  wrong.dash_gap = 7.0;
  const LaneMarkingConstraint found =
      measured(road_of(level, 1.0, 0.0, 1.0, 0.005), markings, wrong);
  EXPECT_EQ(found.constraint.size(), 0);
  EXPECT_NE(found.reason, "");
}

TEST(LaneMarkingConstraint, ACrossingGivesItsDistance) {
  LaneMarkings markings;
  PaintedCrossing c;
  const double z = 14.0;
  const auto pixel = [&](double x, double depth) {
    return Eigen::Vector2d(kCamera.cx + kCamera.fx * x / depth, row_at(depth, level));
  };
  c.first = pixel(-4.0, z);
  c.last = pixel(3.0, z);
  c.along = pixel(-4.0, z - 1.0);
  c.stripes = 8;
  c.sigma = 0.25;
  markings.crossings = {c};
  // Lengths are thought to be 4 % too short.
  const RoadPosterior road = road_of(level, 1.0, 0.0, 0.96, 0.05);
  const LaneMarkingConstraint found = measured(road, markings);
  ASSERT_EQ(found.crossings, 1) << found.reason;
  const RoadPosterior after = road.conditioned(found.constraint);
  EXPECT_NEAR(after.metres_per_baseline(), 1.0, 3.0 * after.scale_sigma());
  EXPECT_LT(after.scale_sigma(), 0.02);
}

}  // namespace
}  // namespace camber
