// Rasters of whole sites: each cell hangs on the points around it alone.

#include "camber/export/site_raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Points on a lattice of centimetres: many at equal distances, and on borders of cells.
std::vector<Vector3d> lattice_points() {
  std::vector<Vector3d> out;
  const CounterRandom random(3);
  for (std::uint64_t i = 0; i < 6000; ++i) {
    const double x = std::round(100.0 * random.uniform(3 * i, 0.0, 30.0)) / 100.0,
                 y = std::round(100.0 * random.uniform(3 * i + 1, 0.0, 20.0)) / 100.0;
    if (std::hypot(x - 12.0, y - 9.0) < 2.5) continue;  // a hole
    out.emplace_back(651000.0 + x, 6270000.0 + y, 480.0 + std::sin(x) + 0.05 * random.normal(i));
  }
  return out;
}

SiteRows rows_of(const SiteGrid& grid, const SiteWindow& window,
                 const std::vector<Vector3d>& points, double reach, int threads) {
  SiteRasterOptions options;
  options.reach = reach;
  options.num_threads = threads;
  SiteRowsMaker maker(grid, window, options);
  for (std::size_t i = 0; i < points.size(); ++i) maker.add(points[i], true);
  return maker.finish();
}

bool same(float a, float b) { return std::memcmp(&a, &b, sizeof(a)) == 0; }

TEST(SiteRaster, CellsAreTheSameInEveryGridAndOrder) {
  std::vector<Vector3d> points = lattice_points();
  const SiteGrid whole({651000.0, 6270000.0}, {651030.0, 6270020.0}, 0.4);
  const SiteRows all = rows_of(whole, {0, 0, whole.rows, whole.columns}, points, 2.0, 1);
  // Another grid, whose cells are the same, with another corner; points from behind.
  std::reverse(points.begin(), points.end());
  const SiteGrid other({650990.0, 6269991.0}, {651050.0, 6270031.0}, 0.4);
  const auto shift_x = std::lround((whole.west - other.west) / 0.4),
             shift_y = std::lround((other.north - whole.north) / 0.4);
  ASSERT_GT(shift_x, 0);
  ASSERT_GT(shift_y, 0);
  const SiteWindow part{static_cast<std::size_t>(shift_y) + 17,
                        static_cast<std::size_t>(shift_x) + 21, 15, 25};
  const SiteRows some = rows_of(other, part, points, 2.0, 3);
  std::size_t known = 0;
  for (std::size_t row = 0; row < part.rows; ++row) {
    for (std::size_t column = 0; column < part.columns; ++column) {
      const std::size_t at = row * part.columns + column,
                        there = (row + 17) * whole.columns + column + 21;
      EXPECT_TRUE(same(some.ground[at], all.ground[there])) << row << " " << column;
      EXPECT_TRUE(same(some.surface[at], all.surface[there]));
      EXPECT_TRUE(same(some.slopes[at], all.slopes[there]));
      EXPECT_TRUE(same(some.sigmas[at], all.sigmas[there]));
      EXPECT_EQ(some.points[at], all.points[there]);
      known += std::isnan(some.ground[at]) ? 0 : 1;
    }
  }
  EXPECT_GT(known, part.rows * part.columns / 2);
}

TEST(SiteRaster, EveryPointIsInACell) {
  const std::vector<Vector3d> points = lattice_points();
  Vector2d low = points.front().head<2>(), high = low;
  for (const Vector3d& p : points) {
    low = low.cwiseMin(Vector2d(p.head<2>()));
    high = high.cwiseMax(Vector2d(p.head<2>()));
  }
  // Borders of the site are borders of cells.
  low = low.array().floor();
  std::vector<Vector3d> with_corner = points;
  with_corner.emplace_back(low.x(), low.y(), 480.0);
  const SiteGrid grid(low, high, 0.5);
  const SiteRows rows = rows_of(grid, {0, 0, grid.rows, grid.columns}, with_corner, 1.0, 1);
  double count = 0.0;
  for (const float n : rows.points) count += n;
  EXPECT_EQ(count, static_cast<double>(with_corner.size()));
}

}  // namespace
}  // namespace camber
