// What strokes of a line and crossings of known size say of scale and ground.

#include "camber/pipeline/marking_statements.h"

#include <gtest/gtest.h>

#include <cmath>

#include "pipeline/profile_road.h"

namespace camber {
namespace {

using namespace test;

const PinholeCamera& kCamera = kRoadCamera;
constexpr double kHeight = kRoadHeight;
const LaneMarkingSizes kSizes{3.0, 6.0, 0.12, 0.5, 0.5};

/// A field of a ground whose inverse depths are off by `bias` of themselves at 40 m, as the square
/// of the depth, and all lengths by `scale`.
GroundField field_of(const Profile& height, double scale, double bias) {
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
  return GroundField(kCamera, observations, Plane{{0, -1, 0}, kHeight * scale},
                     GroundFieldOptions());
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

TEST(MarkingStatements, ABrokenLineTellsTheScaleAndTheFarGround) {
  for (const auto& height : {Profile(level), Profile(hill)}) {
    GroundField field = field_of(height, 1.0, 0.06);
    LaneMarkings markings;
    markings.dashes = strokes({8, 17, 26, 35, 44}, height);
    const double before = 1.0 / field.inverse_depth(markings.dashes[3].centroid);
    const double truth = depth_of(markings.dashes[3].centroid.y(), height);
    ASSERT_LT(before, 0.97 * truth);
    const MarkingStatements said =
        marking_statements(field, kCamera, markings, kSizes, 1.0, 0.01, {}, 4.0);
    EXPECT_EQ(said.reason, "");
    EXPECT_GE(said.dashes, 4);
    EXPECT_GT(said.farthest, 35.0);
    double sigma = 0.01;
    const double change = field.condition(said.statements, {}, 4.0, &sigma);
    EXPECT_LT(sigma, 0.01);
    EXPECT_LT(std::abs(change), 3.0 * sigma);
    const double after = 1.0 / field.inverse_depth(markings.dashes[3].centroid);
    EXPECT_NEAR(after, truth, 0.015 * truth);
  }
}

TEST(MarkingStatements, ALineAloneGivesTheScale) {
  // The field is right up to its unit, of which nothing is known.
  const double unit = 1.3;
  GroundField field = field_of(level, 1.0 / unit, 0.0);
  LaneMarkings markings;
  markings.dashes = strokes({8, 17, 26}, level);
  const MarkingStatements said =
      marking_statements(field, kCamera, markings, kSizes, 1.2, 0.2, {}, 4.0);
  ASSERT_GT(said.statements.values.size(), 0) << said.reason;
  double sigma = 0.2;
  const double change = field.condition(said.statements, {}, 4.0, &sigma);
  EXPECT_LT(sigma, 0.03);
  EXPECT_NEAR(1.2 * std::exp(change), unit, 3.0 * sigma * unit);
  EXPECT_NEAR(said.scale_change, change, 0.1 * sigma);
}

TEST(MarkingStatements, AHiddenStrokeIsPassedOver) {
  const GroundField field = field_of(level, 1.0, 0.0);
  LaneMarkings markings;
  markings.dashes = strokes({8, 26, 35}, level);
  const MarkingStatements said =
      marking_statements(field, kCamera, markings, kSizes, 1.0, 0.01, {}, 4.0);
  EXPECT_EQ(said.dashes, 3) << said.reason;
}

TEST(MarkingStatements, OneBarAloneAndBarsBesideTheRoadSayNothing) {
  const GroundField field = field_of(level, 1.0, 0.0);
  LaneMarkings markings;
  markings.dashes = strokes({8}, level);
  MarkingStatements said = marking_statements(field, kCamera, markings, kSizes, 1.0, 0.01, {}, 4.0);
  EXPECT_EQ(said.statements.values.size(), 0);
  EXPECT_NE(said.reason, "");
  // Two strokes 13 m apart are no line of this kind.
  markings.dashes = strokes({8, 21}, level);
  said = marking_statements(field, kCamera, markings, kSizes, 1.0, 0.01, {}, 4.0);
  EXPECT_EQ(said.statements.values.size(), 0);
  said = marking_statements(field, kCamera, {}, kSizes, 1.0, 0.01, {}, 4.0);
  EXPECT_EQ(said.reason, "no marking of the sizes given is seen whole");
}

TEST(MarkingStatements, WrongSizesAreRefused) {
  const GroundField field = field_of(level, 1.0, 0.0);
  LaneMarkings markings;
  markings.dashes = strokes({8, 17, 26}, level);
  LaneMarkingSizes wrong = kSizes;
  wrong.dash_length = 4.0;
  wrong.dash_gap = 7.0;
  const MarkingStatements said =
      marking_statements(field, kCamera, markings, wrong, 1.0, 0.005, {}, 4.0);
  EXPECT_EQ(said.statements.values.size(), 0);
  EXPECT_NE(said.reason, "");
}

TEST(MarkingStatements, ACrossingTellsItsDistance) {
  GroundField field = field_of(level, 1.0, 0.0);
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
  const MarkingStatements said =
      marking_statements(field, kCamera, markings, kSizes, 0.96, 0.05, {}, 4.0);
  ASSERT_EQ(said.crossings, 1) << said.reason;
  double sigma = 0.05;
  const double change = field.condition(said.statements, {}, 4.0, &sigma);
  EXPECT_NEAR(0.96 * std::exp(change), 1.0, 3.0 * sigma);
  EXPECT_LT(sigma, 0.02);
}

}  // namespace
}  // namespace camber
