#include "camber/road/strip_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

/// A strip along a bend of 80 m radius that climbs 6 % ahead and falls 3 % to the left, with noise
/// of 1 cm a cell and a gross error in one cell of thirty.
RoadStrip made_strip() {
  RoadStrip out;
  std::vector<Eigen::Vector3d> feet;
  for (double a = 0.0; a < 0.6; a += 0.0125) {
    feet.emplace_back(80.0 * std::sin(a), 80.0 * (1.0 - std::cos(a)), 0.06 * 80.0 * a);
  }
  out.line = DrivenLine(feet);
  const CounterRandom random(7);
  std::uint64_t draw = 0;
  for (double s = 0.25; s < 45.0; s += 0.5) {
    for (double lateral = -5.75; lateral < 6.0; lateral += 0.5) {
      StripCell cell;
      cell.s = s;
      cell.lateral = lateral;
      Eigen::Vector2d ahead;
      const Eigen::Vector3d on = out.line.at(s, &ahead);
      const double noise = 0.01 * random.normal(draw++);
      const double gross = random.uniform(draw++) < 1.0 / 30.0 ? 0.5 : 0.0;
      cell.point << on.head<2>() + lateral * Eigen::Vector2d(-ahead.y(), ahead.x()),
          on.z() - 0.03 * lateral + noise + gross;
      cell.sigma = 0.01;
      cell.label = 1;
      out.cells.push_back(cell);
    }
  }
  return out;
}

TEST(StripSurface, FollowsGradeAndBankOfTheStrip) {
  const RoadStrip strip = made_strip();
  StripPatches where;
  const RoadSurface surface = strip_surface(strip, {}, &where);
  ASSERT_EQ(surface.patches.size(), 27U);  // 9 lengths of 5 m, 3 side by side
  ASSERT_EQ(where.of_cell.size(), strip.cells.size());
  ASSERT_EQ(where.stations.size(), surface.patches.size());
  EXPECT_DOUBLE_EQ(where.stations[0], 2.5);
  for (const PlanePatch& patch : surface.patches) {
    EXPECT_EQ(patch.kind, PatchKind::kRoad);
    EXPECT_EQ(patch.status, Status::kOk);
    // Slopes along the tangent at the patch's middle differ from the line's by what 2 m beside the
    // line do to lengths: a twentieth.
    EXPECT_NEAR(std::tan(patch.grade), 0.06, 0.005);
    EXPECT_NEAR(std::tan(patch.bank), -0.03, 0.004);
    EXPECT_GE(patch.boundary.size(), 4U);
    EXPECT_LT(patch.noise, 0.03);
  }
  // Heights are the road's, and the sigma covers what is left of noise and bend.
  double worst = 0.0;
  for (double s = 2.0; s < 43.0; s += 0.7) {
    for (const double lateral : {-4.5, -1.5, 0.0, 3.0}) {
      Eigen::Vector2d ahead;
      Eigen::Vector3d x = strip.line.at(s, &ahead);
      x.head<2>() += lateral * Eigen::Vector2d(-ahead.y(), ahead.x());
      x.z() -= 0.03 * lateral;
      const SurfaceQuery q = surface.query(x, 0.5);
      ASSERT_NE(q.status, Status::kFailed) << s << " " << lateral;
      const double off = std::abs(q.plane.plane.signed_distance(x));
      worst = std::max(worst, off);
      EXPECT_LT(off, 3.0 * q.sigma_height) << s << " " << lateral;
    }
  }
  EXPECT_LT(worst, 0.02);
}

TEST(StripSurface, CountsACommonErrorOnce) {
  // All cells of a patch are one observation: twice as many cells do not make it better known.
  const RoadStrip strip = made_strip();
  const PlanePatch patch = strip_surface(strip).patches[1];
  EXPECT_NEAR(std::sqrt(patch.plane.covariance(2, 2)), 0.01, 0.002);
}

TEST(StripSurface, LeavesOutWhatFewCellsShow) {
  RoadStrip strip = made_strip();
  strip.cells.resize(11);
  EXPECT_TRUE(strip_surface(strip).patches.empty());
  strip.cells.clear();
  EXPECT_TRUE(strip_surface(strip).patches.empty());
  EXPECT_FALSE(strip_surface(strip).driven_line.empty());
}

TEST(StripSurface, RefusesBadOptions) {
  StripSurfaceOptions options;
  options.length = 0.0;
  EXPECT_THROW(strip_surface({}, options), std::invalid_argument);
  options = {};
  options.fewest_cells = 2;
  EXPECT_THROW(strip_surface({}, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
