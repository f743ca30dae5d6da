#include "camber/road/surface_lookup.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/road/road_profile.h"
#include "road/planar_road.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using test::surface_of;

PlanePatch rectangle(int id, double x0, double x1, double y0, double y1, double height,
                     double grade = 0.0) {
  return test::rectangle(id, x0, x1, y0, y1, height, grade, 0.0, {1e-8, 1e-8, 1e-6});
}

/// A road along x that is not seen from 48 to 53, where another crosses 6 m above it.
RoadSurface bridge() {
  return surface_of({rectangle(0, 0, 48, -4, 4, 0.0), rectangle(1, 53, 100, -4, 4, 0.0),
                     rectangle(2, 46, 54, -60, 60, 6.0)});
}

/// Stations covered, on which patch, and that the rest is said to be under the bridge.
void expect_road_below(const std::vector<ProfilePoint>& profile) {
  std::size_t hidden = 0;
  for (const ProfilePoint& point : profile) {
    if (point.status == Status::kFailed) {
      ++hidden;
      EXPECT_EQ(point.reason, "another level: 6.0 m above") << point.station;
      continue;
    }
    EXPECT_NE(point.patch, 2) << point.station;
    EXPECT_NEAR(point.height, 0.0, 1e-9);
    if (std::isfinite(point.grade)) {
      EXPECT_NEAR(point.grade, 0.0, 1e-9);
    }
  }
  EXPECT_EQ(hidden, 4u);  // 49 to 52
}

TEST(SurfaceLookup, LineUnderABridgeKeepsToItsRoad) {
  expect_road_below(road_profile(bridge(), {{0, 0, 0}, {100, 0, 0}}, {}));
  const auto above = road_profile(bridge(), {{50, -50, 6}, {50, 50, 6}}, {});
  for (const ProfilePoint& point : above) EXPECT_EQ(point.patch, 2);
}

TEST(SurfaceLookup, ConstantOffsetOfTheLineIsFound) {
  for (const double offset : {-300.0, -1.0, 0.4, 2.2, 5.0}) {
    SCOPED_TRACE(offset);
    std::vector<Vector3d> line;
    for (double x = 0.0; x <= 100.0; x += 10.0) line.emplace_back(x, 0.0, offset);
    const LineOverGround over = SurfaceLookup(bridge()).follow(line, 0.5);
    EXPECT_NEAR(over.offset, offset, 1e-9);
    expect_road_below(road_profile(bridge(), line, {}));
  }
}

TEST(SurfaceLookup, LineWithoutHeightsFollowsHills) {
  // 6 % up, then 9 % down, 30 m in all, with a gap; the line is at 0.
  const RoadSurface surface = surface_of({rectangle(0, 0, 200, -4, 4, 250.0, 0.06),
                                          rectangle(1, 200, 290, -4, 4, 262.0, -0.09),
                                          rectangle(2, 310, 600, -4, 4, 252.1, -0.09)});
  for (const double z : {0.0, 255.0}) {
    std::size_t covered = 0;
    for (const ProfilePoint& point : road_profile(surface, {{0, 0, z}, {600, 0, z}}, {})) {
      covered += point.status != Status::kFailed ? 1 : 0;
    }
    EXPECT_EQ(covered, 582u) << z;  // but 291 to 309
  }
}

TEST(SurfaceLookup, RampKeepsToItsTurn) {
  // Two turns over one another, 3 m apart, along one line there and back; each has a gap.
  const RoadSurface surface =
      surface_of({rectangle(0, 0, 40, -4, 4, 0.0), rectangle(1, 41.2, 100, -4, 4, 0.0),
                  rectangle(2, 0, 70, -4, 4, 3.0), rectangle(3, 71.2, 100, -4, 4, 3.0)});
  const auto profile =
      road_profile(surface, {{0, 0, 0}, {100, 0, 0}, {100.001, 0, 3}, {0, 0, 3}}, {});
  for (const ProfilePoint& point : profile) {
    const double truth = point.station <= 100.0005 ? 0.0 : 3.0;
    if (point.status == Status::kFailed) {
      EXPECT_NE(point.reason.find("another level"), std::string::npos);
    } else {
      EXPECT_NEAR(point.height, truth, 1e-6) << point.station;
    }
  }
}

TEST(SurfaceLookup, PatchesOfOtherKindUnderALineAreTaken) {
  // A service road 3 m lower, and the verge between it and the road.
  RoadSurface surface =
      surface_of({rectangle(0, 0, 60, -4, 4, 0.0), rectangle(1, 0, 60, -20, -14, -3.0),
                  rectangle(2, 0, 60, -13.9, -4, -1.5)});
  surface.patches[1].kind = surface.patches[2].kind = PatchKind::kOther;
  const std::vector<Vector3d> road = {{0, 0, 0}, {60, 0, 0}},
                              service = {{0, -17, -3}, {60, -17, -3}};
  EXPECT_EQ(road_profile(surface, service, {})[30].status, Status::kFailed);
  EXPECT_TRUE(take_as_road(road, 0.5, &surface).empty());
  EXPECT_EQ(take_as_road(service, 0.5, &surface), std::vector<int>{1});
  EXPECT_EQ(surface.patches[1].kind, PatchKind::kRoad);
  EXPECT_EQ(surface.patches[2].kind, PatchKind::kOther);
  EXPECT_NEAR(road_profile(surface, service, {})[30].height, -3.0, 1e-9);
  EXPECT_TRUE(take_as_road({}, 0.5, &surface).empty());
  // Road within reach goes first, unless it is of another level.
  surface = surface_of({rectangle(0, 0, 29.8, -4, 4, 0.0), rectangle(1, 0, 60, -9, 9, 0.3),
                        rectangle(2, 20, 30, -9, 9, 6.0)});
  surface.patches[1].kind = PatchKind::kOther;
  EXPECT_TRUE(take_as_road({{0, 0, 0}, {30, 0, 0}}, 0.5, &surface).empty());
  EXPECT_EQ(take_as_road({{0, -8, 0.3}, {30, -8, 0.3}}, 0.5, &surface), std::vector<int>{1});
}

}  // namespace
}  // namespace camber
