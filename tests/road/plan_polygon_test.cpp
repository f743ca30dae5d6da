#include "camber/road/plan_polygon.h"

#include <gtest/gtest.h>

#include <cmath>

namespace camber {
namespace {

using Eigen::Vector2d;

PlanPolygon square(double x, double y, double side) {
  return {{x, y}, {x + side, y}, {x + side, y + side}, {x, y + side}};
}

TEST(PlanPolygon, HullLeavesOutInnerAndCollinearPoints) {
  const PlanPolygon hull =
      convex_hull({{0, 0}, {2, 0}, {1, 0}, {2, 2}, {0, 2}, {1, 1}, {0, 0}, {0.5, 1.5}});
  EXPECT_EQ(hull.size(), 4u);
  EXPECT_DOUBLE_EQ(polygon_area(hull), 4.0);
}

TEST(PlanPolygon, HullOfFewOrCollinearPoints) {
  EXPECT_TRUE(convex_hull({}).empty());
  EXPECT_EQ(convex_hull({{1, 1}, {1, 1}}).size(), 1u);
  EXPECT_EQ(convex_hull({{0, 0}, {1, 1}, {2, 2}}).size(), 2u);
}

TEST(PlanPolygon, DistanceInsideOutsideAndToACorner) {
  const PlanPolygon polygon = square(0, 0, 2);
  EXPECT_EQ(distance_to_polygon(polygon, {1, 1}), 0.0);
  EXPECT_DOUBLE_EQ(distance_to_polygon(polygon, {3, 1}), 1.0);
  EXPECT_DOUBLE_EQ(distance_to_polygon(polygon, {3, 3}), std::sqrt(2.0));
  EXPECT_TRUE(std::isinf(distance_to_polygon({}, {0, 0})));
}

TEST(PlanPolygon, GapBetweenAndOverlap) {
  const PolygonGap apart = polygon_gap(square(0, 0, 2), square(5, 0, 2));
  EXPECT_DOUBLE_EQ(apart.distance, 3.0);
  EXPECT_DOUBLE_EQ(apart.on_a.x(), 2.0);
  EXPECT_DOUBLE_EQ(apart.on_b.x(), 5.0);
  EXPECT_EQ(apart.overlap_area, 0.0);
  const PolygonGap over = polygon_gap(square(0, 0, 2), square(1, 1, 2));
  EXPECT_EQ(over.distance, 0.0);
  EXPECT_DOUBLE_EQ(over.overlap_area, 1.0);
  EXPECT_TRUE(over.on_a.isApprox(Vector2d(1.5, 1.5)));
}

TEST(PlanPolygon, AreasInMapCoordinates) {
  // Doubles hold them to 1e-9 m.
  EXPECT_NEAR(polygon_area(square(4.5e6, 5.1e5, 0.25)), 0.0625, 1e-8);
  const PolygonGap touching = polygon_gap(square(4.5e6, 5.1e5, 1), square(4.5e6 + 1.0, 5.1e5, 1));
  EXPECT_NEAR(touching.overlap_area, 0.0, 1e-8);
}

}  // namespace
}  // namespace camber
