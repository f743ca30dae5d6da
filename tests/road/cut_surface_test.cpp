#include "camber/road/cut_surface.h"

#include <gtest/gtest.h>

#include "camber/road/plan_polygon.h"

namespace camber {
namespace {

double area_of(const std::vector<Eigen::Vector3d>& polygon) {
  PlanPolygon flat;
  for (const Eigen::Vector3d& x : polygon) flat.push_back(x.head<2>());
  return polygon_area(flat);
}

TEST(CutPolygon, KeepsTheInsideOnItsPlane) {
  // A square turned by 45 degrees on the plane z = 2 + x / 10 - y / 5.
  const auto at = [](double x, double y) { return Eigen::Vector3d(x, y, 2.0 + 0.1 * x - 0.2 * y); };
  const std::vector<Eigen::Vector3d> square = {at(-2, 0), at(0, -2), at(2, 0), at(0, 2)};
  const auto cut = cut_polygon(square, {-1, -1, 1, 5});
  // The triangles that go: two of area 1 at the sides, one of area 1 below.
  EXPECT_NEAR(area_of(cut), 8.0 - 3.0, 1e-12);
  for (const Eigen::Vector3d& x : cut) {
    EXPECT_NEAR(x.z(), at(x.x(), x.y()).z(), 1e-12);
    EXPECT_TRUE(x.x() >= -1 && x.x() <= 1 && x.y() >= -1);
  }
  EXPECT_EQ(cut_polygon(square, {-9, -9, 9, 9}), square);
  EXPECT_TRUE(cut_polygon(square, {3, 3, 4, 4}).empty());
}

TEST(CutSurface, LeavesPatchesWithPointsAndTheirLinks) {
  RoadSurface surface;
  surface.up = Eigen::Vector3d::UnitZ();
  for (int id = 0; id < 3; ++id) {
    PlanePatch patch;
    patch.id = id;
    const double x = 10.0 * id;
    patch.boundary = {{x, 0, 0}, {x + 10, 0, 0}, {x + 10, 10, 0}, {x, 10, 0}};
    surface.patches.push_back(patch);
  }
  for (int id = 0; id < 2; ++id) {
    PatchLink link;
    link.a = id;
    link.b = id + 1;
    surface.links.push_back(link);
  }
  surface.ego_patch = 2;
  cut_surface({5, 2, 15, 8}, {0, 0, 1, -1}, &surface);
  ASSERT_EQ(surface.patches.size(), 2u);
  EXPECT_NEAR(area_of(surface.patches[0].boundary), 5.0 * 6.0, 1e-12);
  EXPECT_NEAR(area_of(surface.patches[1].boundary), 5.0 * 6.0, 1e-12);
  ASSERT_EQ(surface.links.size(), 1u);
  EXPECT_EQ(surface.links[0].b, 1);
  EXPECT_EQ(surface.ego_patch, -1);
}

}  // namespace
}  // namespace camber
