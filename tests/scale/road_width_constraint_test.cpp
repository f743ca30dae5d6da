// What the width of the road measures of the far ground.

#include "camber/scale/road_width_constraint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "scale/profile_road.h"
#include "support/made_road.h"

namespace camber {
namespace {

using namespace test;

const PinholeCamera& kCamera = kRoadCamera;
constexpr double kHeight = kRoadHeight;

/// A road whose inverse depths are off by `bias` of themselves at 40 m, as the square
/// of the depth; the shared parameter (of the motion, say) is that bias.
RoadPosterior road_of(const Profile& height, double bias) {
  GroundObservations observations;
  std::vector<float> shared;
  for (int v = 110; v < kCamera.height; v += 2) {
    const double z = depth_of(v, height);
    if (z > 80.0) continue;
    for (int u = 0; u < kCamera.width; u += 4) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back((1.0 + bias * z * z / 1600.0) / z);
      observations.sigma.push_back(0.0007);
      shared.push_back(static_cast<float>(z / 1600.0));
    }
  }
  observations.shared_jacobian =
      Eigen::Map<const Eigen::VectorXf>(shared.data(), static_cast<Eigen::Index>(shared.size()));
  return road_posterior(
      std::make_shared<GroundField>(kCamera, observations, Plane{{0, -1, 0}, kHeight},
                                    GroundFieldOptions()),
      Eigen::MatrixXd::Constant(1, 1, 0.05 * 0.05), kHeight, 1.0, 0.01);
}

/// Edges at x = left(z) and right(z) as they are seen to 60 m; NaN: hidden.
RoadEdges edges_of(const Profile& height, const Profile& left, const Profile& right) {
  RoadEdges out;
  for (int v = kCamera.height - 1; v > 100; --v) {
    const double z = depth_of(v, height);
    if (z > 60.0) break;
    for (const auto& [side, at] :
         {std::pair{&out.left, left(z)}, std::pair{&out.right, right(z)}}) {
      const double u = kCamera.cx + kCamera.fx * at / z;
      if (!(u > 2) || !(u < kCamera.width - 3)) continue;
      side->push_back({v, u, !side->empty() && side->back().row == v + 1});
    }
  }
  return out;
}

Profile at(double x) {
  return [x](double) { return x; };
}

RoadWidthConstraint measured(const RoadPosterior& road, const RoadEdges& edges) {
  return road_width_constraint(road, kCamera, edges);
}

/// Depth by the road on its middle where the ground is 40 m away, over the true one.
double ratio_at_40(const RoadPosterior& road, const Profile& height) {
  const Eigen::Vector2d pixel(kCamera.cx, kCamera.cy + kCamera.fy * height(40.0) / 40.0);
  return 1.0 / road.inverse_depth(pixel) / 40.0;
}

TEST(RoadWidthConstraint, TheWidthMeasuresTheFarGroundButNotTheScale) {
  for (const Profile& height : {Profile(level), Profile(hill)}) {
    const RoadPosterior road = road_of(height, 0.08);
    ASSERT_LT(ratio_at_40(road, height), 0.95);
    const RoadWidthConstraint found = measured(road, edges_of(height, at(-4.0), at(3.5)));
    ASSERT_EQ(found.reason, "");
    EXPECT_GE(found.places, 8);
    EXPECT_EQ(found.rejected, 0);
    EXPECT_GT(found.farthest, 38.0);
    EXPECT_NEAR(found.width, 7.5, 0.1);
    EXPECT_LT(found.misfit_after, found.misfit_before);
    const RoadPosterior after = road.conditioned(found.constraint);
    EXPECT_NEAR(std::log(after.metres_per_baseline()), 0.0, 0.002);
    EXPECT_NEAR(ratio_at_40(after, height), 1.0, 0.025);
  }
}

TEST(RoadWidthConstraint, AWidthThatStaysMovesNothing) {
  const RoadPosterior road = road_of(hill, 0.0);
  const RoadWidthConstraint found = measured(road, edges_of(hill, at(-4.0), at(3.5)));
  ASSERT_EQ(found.reason, "");
  EXPECT_NEAR(ratio_at_40(road.conditioned(found.constraint), hill), ratio_at_40(road, hill),
              0.004);
}

TEST(RoadWidthConstraint, ACurvedRoadIsMeasuredAcrossItsDirection) {
  // Concentric edges; a slice of it along a row at 40 m is 9 % longer than it is wide.
  const auto edge = [](double radius) {
    return [radius](double z) { return 100.0 - std::sqrt(radius * radius - z * z); };
  };
  const RoadPosterior road = road_of(level, 0.0);
  const RoadWidthConstraint found = measured(road, edges_of(level, edge(103.0), edge(96.5)));
  ASSERT_EQ(found.reason, "");
  EXPECT_NEAR(found.width, 6.5, 0.07);
  EXPECT_NEAR(ratio_at_40(road.conditioned(found.constraint), level), ratio_at_40(road, level),
              0.015);
}

TEST(RoadWidthConstraint, MouthsAndBaysDoNotAct) {
  // The mouth of a side street from 14 to 22 m, and a bay from 15 m on.
  const Profile mouth = [](double z) { return z > 14.0 && z < 22.0 ? -7.0 : -4.0; };
  const Profile bay = [](double z) { return z > 15.0 ? 5.9 : 3.5; };
  const RoadPosterior road = road_of(level, 0.0);
  const double before = ratio_at_40(road, level);
  const RoadWidthConstraint beside = measured(road, edges_of(level, mouth, at(3.5)));
  ASSERT_EQ(beside.reason, "");
  EXPECT_GE(beside.rejected, 1);
  EXPECT_GT(beside.farthest, 30.0);
  EXPECT_NEAR(ratio_at_40(road.conditioned(beside.constraint), level), before, 0.02);

  const RoadWidthConstraint wider = measured(road, edges_of(level, at(-4.0), bay));
  if (wider.constraint.size() > 0) {
    EXPECT_GE(wider.rejected, 1);
  } else {
    EXPECT_NE(wider.reason, "");
  }
  EXPECT_NEAR(ratio_at_40(road.conditioned(wider.constraint), level), before, 0.02);
}

TEST(RoadWidthConstraint, EdgesHiddenOverAStretchStillMeasure) {
  const Profile hidden = [](double z) { return z > 12.0 && z < 25.0 ? std::nan("") : 3.5; };
  const RoadPosterior road = road_of(hill, 0.08);
  const RoadWidthConstraint found = measured(road, edges_of(hill, at(-4.0), hidden));
  ASSERT_EQ(found.reason, "");
  EXPECT_GT(found.farthest, 30.0);
  EXPECT_NEAR(ratio_at_40(road.conditioned(found.constraint), hill), 1.0, 0.035);
}

TEST(RoadWidthConstraint, WithoutTwoEdgesNothingIsMeasured) {
  const RoadPosterior road = road_of(level, 0.0);
  EXPECT_EQ(measured(road, {}).reason, "the road's borders are not seen");
  RoadEdges one = edges_of(level, at(-4.0), at(3.5));
  one.right.clear();
  EXPECT_EQ(measured(road, one).reason, "the road's borders are not seen");
  const Profile near = [](double z) { return z < 5.3 ? 2.0 : std::nan(""); };
  const RoadWidthConstraint found = measured(road, edges_of(level, at(-2.0), near));
  EXPECT_EQ(found.constraint.size(), 0);
  EXPECT_NE(found.reason, "");
}

}  // namespace
}  // namespace camber
