// What the width of the road says of the far ground.

#include "camber/pipeline/width_statements.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "pipeline/profile_road.h"

namespace camber {
namespace {

using namespace test;

const PinholeCamera& kCamera = kRoadCamera;
constexpr double kHeight = kRoadHeight;

/// A field of a ground whose inverse depths are off by `bias` of themselves at 40 m, as the square
/// of the depth; the shared parameter (of the motion, say) is that bias.
GroundField field_of(const Profile& height, double bias) {
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
  return GroundField(kCamera, observations, Plane{{0, -1, 0}, kHeight}, GroundFieldOptions());
}

/// Borders at x = left(z) and right(z) as they are seen to 60 m; NaN: hidden.
RoadBorders borders_of(const Profile& height, const Profile& left, const Profile& right) {
  RoadBorders out;
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

/// Of the bias.
const Eigen::MatrixXd kShared = Eigen::MatrixXd::Constant(1, 1, 0.05 * 0.05);

WidthStatements say(const GroundField& field, const RoadBorders& borders) {
  return width_statements(field, kCamera, borders, 1.0, 0.01, kShared, 4.0);
}

/// Depth by the field on the middle of the road where the ground is 40 m away, over the true one.
double ratio_at_40(const GroundField& field, const Profile& height) {
  const Eigen::Vector2d pixel(kCamera.cx, kCamera.cy + kCamera.fy * height(40.0) / 40.0);
  return 1.0 / field.inverse_depth(pixel) / 40.0;
}

double condition(GroundField& field, const WidthStatements& said) {
  double sigma = 0.01;
  return field.condition(said.statements, kShared, 4.0, &sigma);
}

TEST(WidthStatements, TheWidthTellsTheFarGroundButNotTheScale) {
  for (const Profile& height : {Profile(level), Profile(hill)}) {
    GroundField field = field_of(height, 0.08);
    ASSERT_LT(ratio_at_40(field, height), 0.95);
    const WidthStatements said = say(field, borders_of(height, at(-4.0), at(3.5)));
    ASSERT_EQ(said.reason, "");
    EXPECT_GE(said.places, 8);
    EXPECT_EQ(said.refused, 0);
    EXPECT_GT(said.farthest, 38.0);
    EXPECT_NEAR(said.width, 7.5, 0.1);
    EXPECT_LT(said.misfit_after, said.misfit_before);
    EXPECT_NEAR(condition(field, said), 0.0, 0.002);
    EXPECT_NEAR(ratio_at_40(field, height), 1.0, 0.025);
  }
}

TEST(WidthStatements, AWidthThatIsKeptMovesNothing) {
  GroundField field = field_of(hill, 0.0);
  const double before = ratio_at_40(field, hill);
  const WidthStatements said = say(field, borders_of(hill, at(-4.0), at(3.5)));
  ASSERT_EQ(said.reason, "");
  condition(field, said);
  EXPECT_NEAR(ratio_at_40(field, hill), before, 0.004);
}

TEST(WidthStatements, ACurvedRoadIsMeasuredAcrossItsDirection) {
  // Concentric borders; a slice of it along a row at 40 m is 9 % longer than it is wide.
  const auto border = [](double radius) {
    return [radius](double z) { return 100.0 - std::sqrt(radius * radius - z * z); };
  };
  GroundField field = field_of(level, 0.0);
  const WidthStatements said = say(field, borders_of(level, border(103.0), border(96.5)));
  ASSERT_EQ(said.reason, "");
  EXPECT_NEAR(said.width, 6.5, 0.07);
  const double before = ratio_at_40(field, level);
  condition(field, said);
  EXPECT_NEAR(ratio_at_40(field, level), before, 0.015);
}

TEST(WidthStatements, MouthsAndBaysDoNotAct) {
  // The mouth of a side street from 14 to 22 m, and a bay from 15 m on.
  const Profile mouth = [](double z) { return z > 14.0 && z < 22.0 ? -7.0 : -4.0; };
  const Profile bay = [](double z) { return z > 15.0 ? 5.9 : 3.5; };
  GroundField field = field_of(level, 0.0);
  const double before = ratio_at_40(field, level);
  const WidthStatements beside = say(field, borders_of(level, mouth, at(3.5)));
  ASSERT_EQ(beside.reason, "");
  EXPECT_GE(beside.refused, 1);
  EXPECT_GT(beside.farthest, 30.0);
  condition(field, beside);
  EXPECT_NEAR(ratio_at_40(field, level), before, 0.02);

  GroundField wider = field_of(level, 0.0);
  const WidthStatements said = say(wider, borders_of(level, at(-4.0), bay));
  if (said.statements.values.size() > 0) {
    EXPECT_GE(said.refused, 1);
    condition(wider, said);
  } else {
    EXPECT_NE(said.reason, "");
  }
  EXPECT_NEAR(ratio_at_40(wider, level), before, 0.02);
}

TEST(WidthStatements, BordersHiddenOverAStretchStillTell) {
  const Profile hidden = [](double z) { return z > 12.0 && z < 25.0 ? std::nan("") : 3.5; };
  GroundField field = field_of(hill, 0.08);
  const WidthStatements said = say(field, borders_of(hill, at(-4.0), hidden));
  ASSERT_EQ(said.reason, "");
  EXPECT_GT(said.farthest, 30.0);
  condition(field, said);
  EXPECT_NEAR(ratio_at_40(field, hill), 1.0, 0.035);
}

TEST(WidthStatements, WithoutTwoBordersNothingIsSaid) {
  const GroundField field = field_of(level, 0.0);
  EXPECT_EQ(say(field, {}).reason, "the road's borders are not seen");
  RoadBorders one = borders_of(level, at(-4.0), at(3.5));
  one.right.clear();
  EXPECT_EQ(say(field, one).reason, "the road's borders are not seen");
  const Profile near = [](double z) { return z < 5.3 ? 2.0 : std::nan(""); };
  const WidthStatements said = say(field, borders_of(level, at(-2.0), near));
  EXPECT_EQ(said.statements.values.size(), 0);
  EXPECT_NE(said.reason, "");
}

}  // namespace
}  // namespace camber
