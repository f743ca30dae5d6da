// The road found without a mask: a street with a kerb, a pavement and a wall.

#include "camber/road/grow_road.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

const PinholeCamera kCamera{960, 320, 600.0, 600.0, 480.0, 130.0};
constexpr double kHeight = 1.65;
enum Surface { kNothing, kRoad, kKerb, kPavement, kWall };

struct Street {
  GridInverseDepth grid;
  std::vector<Surface> surface;  ///< truth, one a grid point
};

/// A road 8 m wide; on its right a kerb 15 cm high, 2 m of pavement and a wall 6 m high; on its
/// left a wall that stands on the road's edge.
Street make_street(double unit, std::uint64_t seed) {
  Street out;
  GridInverseDepth& grid = out.grid;
  grid.step = 2;
  grid.columns = (kCamera.width - 1) / grid.step + 1;
  grid.rows = (kCamera.height - 1) / grid.step + 1;
  const CounterRandom random(seed);
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const Eigen::Vector3d ray = kCamera.ray(Eigen::Vector2d(c * grid.step, r * grid.step));
      double nearest = 60.0;
      Surface seen = kNothing;
      const auto hit = [&](Surface surface, double z, double low, double high, bool upright) {
        if (!(z > 0) || z >= nearest) return;
        const double at = upright ? z * ray.y() : z * ray.x();
        if (at < low || at > high) return;
        nearest = z;
        seen = surface;
      };
      hit(kRoad, kHeight / ray.y(), -4.0, 4.0, false);
      hit(kPavement, (kHeight - 0.15) / ray.y(), 4.0, 6.0, false);
      hit(kKerb, 4.0 / ray.x(), kHeight - 0.15, kHeight, true);
      hit(kWall, 6.0 / ray.x(), kHeight - 6.15, kHeight - 0.15, true);
      hit(kWall, -4.0 / ray.x(), kHeight - 6.0, kHeight, true);
      const std::uint64_t i = out.surface.size();
      const double rho = 1.0 / nearest;
      // 0.15 px of parallax over a baseline of 1 m ahead, known to twice that at the focus.
      const double sigma = 0.15 / (std::hypot(ray.x(), ray.y()) * 600.0 + 10.0);
      out.surface.push_back(seen);
      grid.inverse_depth.push_back(seen == kNothing ? std::nan("")
                                                    : unit * (rho + sigma * random.normal(i)));
      grid.sigma.push_back(unit * sigma);
    }
  }
  return out;
}

TEST(GrowRoad, TakesTheRoadAndNotTheWall) {
  for (const double unit : {1.0, 0.8}) {
    SCOPED_TRACE(unit);
    const Street street = make_street(unit, 1);
    const GrownRoad found = grow_road(kCamera, street.grid, {0, 0, 1}, {});
    ASSERT_EQ(found.status, Status::kOk) << found.reason;
    // The near road is seen at 2 to 10 % of its depth a pixel: the seed is good to a percent.
    EXPECT_NEAR(found.ego.offset * unit, kHeight, 0.02 * kHeight);
    EXPECT_LT(angle_between(found.ego.normal, {0, -1, 0}), 0.01);
    ASSERT_EQ(found.ground.size(), street.surface.size());
    // Judged within 25 m: beyond, one pixel is more than half a metre of road and the heights are
    // less certain than a kerb.
    long judged = 0, right = 0, road = 0, road_found = 0, wall = 0, wall_taken = 0;
    for (std::size_t i = 0; i < found.ground.size(); ++i) {
      const double rho = street.grid.inverse_depth[i] / unit;
      if (!(rho > 1.0 / 25.0)) continue;
      // Kerb and pavement may go either way: vehicles stand on both.
      if (street.surface[i] == kKerb || street.surface[i] == kPavement) continue;
      const bool is_road = street.surface[i] == kRoad, taken = found.ground[i] != 0;
      const Eigen::Vector2d pixel(static_cast<int>(i) % street.grid.columns * 2,
                                  static_cast<int>(i) / street.grid.columns * 2);
      // The foot of a wall is as near to the ground as a kerb is.
      if (street.surface[i] == kWall && kCamera.ray(pixel).y() / rho > kHeight - 0.50) continue;
      ++judged;
      right += is_road == taken;
      road += is_road;
      road_found += is_road && taken;
      if (street.surface[i] == kWall) {
        ++wall;
        wall_taken += taken;
      }
    }
    EXPECT_GT(wall, 5000);
    EXPECT_GT(static_cast<double>(right), 0.95 * static_cast<double>(judged));
    EXPECT_GT(static_cast<double>(road_found), 0.95 * static_cast<double>(road));
    EXPECT_EQ(wall_taken, 0);
  }
}

TEST(GrowRoad, AShadowThatMovesWithTheCarAheadIsNoRoad) {
  // The road ends at 9 m and 2.2 m to the sides; most of it is a shadow of 2.6 m, which moves as a
  // plane 5 m below the camera would.
  constexpr double kFollows = 0.33;  // of the parallax of what stands still
  Street street = make_street(1.0, 1);
  long lit = 0, shadow = 0;
  std::vector<std::uint8_t> is_shadow(street.surface.size(), 0);
  for (std::size_t i = 0; i < street.surface.size(); ++i) {
    double& rho = street.grid.inverse_depth[i];
    const Eigen::Vector2d pixel(static_cast<int>(i) % street.grid.columns * 2,
                                static_cast<int>(i) / street.grid.columns * 2);
    const double depth = kHeight / kCamera.ray(pixel).y();
    const double side = std::abs(depth * kCamera.ray(pixel).x());
    if (street.surface[i] != kRoad || depth > 9.0 || side > 2.2) {
      rho = std::nan("");
    } else if (side < 1.3) {
      rho *= kFollows;
      is_shadow[i] = 1;
      ++shadow;
    } else {
      ++lit;
    }
  }
  ASSERT_GT(shadow, lit);
  const GrownRoad found = grow_road(kCamera, street.grid, {0, 0, 1}, {});
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  EXPECT_NEAR(found.ego.offset, kHeight, 0.03 * kHeight);
  for (std::size_t i = 0; i < is_shadow.size(); ++i) {
    ASSERT_FALSE(is_shadow[i] && found.ground[i]) << i;
  }
}

TEST(GrowRoad, IsTheSameEveryTime) {
  const Street street = make_street(1.0, 2);
  const GrownRoad a = grow_road(kCamera, street.grid, {0, 0, 1}, {});
  const GrownRoad b = grow_road(kCamera, street.grid, {0, 0, 1}, {});
  EXPECT_EQ(a.ground, b.ground);
  EXPECT_EQ(a.ego.normal, b.ego.normal);
  EXPECT_EQ(a.ego.offset, b.ego.offset);
}

TEST(GrowRoad, WithoutPointsThereIsNoRoad) {
  Street street = make_street(1.0, 1);
  for (double& rho : street.grid.inverse_depth) rho = std::nan("");
  const GrownRoad found = grow_road(kCamera, street.grid, {0, 0, 1}, {});
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("0 cells are triangulated"));
  for (const std::uint8_t g : found.ground) ASSERT_EQ(g, 0);
}

TEST(GrowRoad, RandomDepthsAreNoRoad) {
  Street street = make_street(1.0, 1);
  const CounterRandom random(4);
  for (std::size_t i = 0; i < street.grid.inverse_depth.size(); ++i) {
    const std::uint64_t cell = i % static_cast<std::size_t>(street.grid.columns) / 6 +
                               1000 * (i / static_cast<std::size_t>(street.grid.columns) / 3);
    street.grid.inverse_depth[i] = random.uniform(cell, 0.02, 1.0);
  }
  const GrownRoad found = grow_road(kCamera, street.grid, {0, 0, 1}, {});
  long taken = 0;
  for (const std::uint8_t g : found.ground) taken += g;
  EXPECT_LT(taken, static_cast<long>(found.ground.size()) / 20);
}

TEST(GrowRoadOptions, ValidateNamesTheField) {
  GrowRoadOptions options;
  EXPECT_NO_THROW(options.validate());
  options.cell_rows = 1;
  EXPECT_THROW(grow_road(kCamera, make_street(1.0, 1).grid, {0, 0, 1}, options),
               std::invalid_argument);
  options = {};
  options.step_height = 0.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace camber
