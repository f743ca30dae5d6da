#include "camber/road/road_surface.h"

#include <gtest/gtest.h>

#include <limits>

namespace camber {
namespace {

PlanePatch square_patch(int id, double x0, double height, PatchKind kind = PatchKind::kRoad) {
  PlanePatch patch;
  patch.id = id;
  patch.kind = kind;
  patch.status = Status::kOk;
  patch.plane.plane = Plane::through({0, 0, height}, Eigen::Vector3d::UnitZ());
  patch.plane.centroid = {x0 + 5, 5, height};
  patch.plane.axis1 = Eigen::Vector3d::UnitX();
  patch.plane.axis2 = Eigen::Vector3d::UnitY();
  patch.plane.covariance = Eigen::Vector3d(1e-6, 1e-6, 1e-4).asDiagonal();
  patch.boundary = {{x0, 0, height}, {x0 + 10, 0, height}, {x0 + 10, 10, height}, {x0, 10, height}};
  return patch;
}

RoadSurface two_squares() {
  RoadSurface surface;
  surface.frame = "z-up";
  surface.up = Eigen::Vector3d::UnitZ();
  surface.patches = {square_patch(3, 0, 1.0), square_patch(8, 12, 2.0)};
  return surface;
}

TEST(RoadSurface, FindsByIdNotByPosition) {
  const RoadSurface surface = two_squares();
  ASSERT_NE(surface.find(8), nullptr);
  EXPECT_EQ(surface.find(8)->id, 8);
  EXPECT_EQ(surface.find(1), nullptr);
}

TEST(RoadSurface, AnswersInsideOnThePatch) {
  const SurfaceQuery answer = two_squares().query({5, 5, 40});
  EXPECT_EQ(answer.status, Status::kOk);
  EXPECT_EQ(answer.patch, 3);
  EXPECT_TRUE(answer.point.isApprox(Eigen::Vector3d(5, 5, 1)));
  EXPECT_NEAR(answer.sigma_height, 0.01, 1e-12);  // the square root of the height variance
}

TEST(RoadSurface, SigmaGrowsTowardsTheEdgeAndBeyondIt) {
  const RoadSurface surface = two_squares();
  const double middle = surface.query({5, 5, 0}).sigma_height;
  const double edge = surface.query({0.01, 5, 0}).sigma_height;
  const SurfaceQuery beyond = surface.query({-1.5, 5, 0});
  EXPECT_LT(middle, edge);
  EXPECT_LT(edge, beyond.sigma_height);
  EXPECT_EQ(beyond.status, Status::kWeak);
  EXPECT_EQ(beyond.patch, 3);
}

TEST(RoadSurface, SaysNotCoveredBeyondTheReach) {
  const SurfaceQuery answer = two_squares().query({5, 12.5, 0});
  EXPECT_EQ(answer.status, Status::kFailed);
  EXPECT_EQ(answer.reason, "not covered");
  EXPECT_EQ(two_squares().query({5, 12.5, 0}, 3.0).patch, 3);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(two_squares().query({5, 12.5, 0}, nan).status, Status::kFailed);
  EXPECT_EQ(two_squares().query_ray({5, 500, 9}, {0, 0, -1}, nan).status, Status::kFailed);
}

TEST(RoadSurface, GapBelongsToTheNearerPatch) {
  EXPECT_EQ(two_squares().query({10.8, 5, 0}).patch, 3);
  EXPECT_EQ(two_squares().query({11.2, 5, 0}).patch, 8);
}

TEST(RoadSurface, OverpassIsToldApartByHeightAndWallsNeverAnswer) {
  RoadSurface surface = two_squares();
  surface.patches.push_back(square_patch(9, 0, 7.0));
  surface.patches.push_back(square_patch(10, 0, 2.0, PatchKind::kOther));
  EXPECT_EQ(surface.query({5, 5, 2.0}).patch, 3);
  EXPECT_EQ(surface.query({5, 5, 6.5}).patch, 9);
}

TEST(RoadSurface, AnotherLevelDoesNotAnswerWhereItsOwnIsWithinReach) {
  RoadSurface surface = two_squares();
  surface.patches.push_back(square_patch(9, 10.5, 7.0));  // begins nearer than the first one ends
  EXPECT_EQ(surface.query({10.4, 5, 1.2}).patch, 3);
  EXPECT_EQ(surface.query({10.4, 5, 6.8}).patch, 9);
  // Heights that the patches' own uncertainty explains are of one level.
  surface.patches.back().plane.covariance(2, 2) = 4.0;
  EXPECT_EQ(surface.query({10.4, 5, 1.2}).patch, 9);
  surface.patches.back().plane.covariance(2, 2) = 1e-4;
  surface.metric = false;
  EXPECT_EQ(surface.query({10.4, 5, 1.2}).patch, 9);
}

TEST(RoadSurface, CameraFrameLooksAlongItsUp) {
  RoadSurface surface;
  PlanePatch patch = square_patch(0, 0, 0);
  patch.plane.plane = {{0, -1, 0}, 1.65};
  patch.boundary = {{-3, 1.65, 5}, {3, 1.65, 5}, {3, 1.65, 20}, {-3, 1.65, 20}};
  surface.patches = {patch};
  EXPECT_TRUE(surface.query({1, 0, 10}).point.isApprox(Eigen::Vector3d(1, 1.65, 10)));
  EXPECT_EQ(surface.query({1, 0, 30}).status, Status::kFailed);
}

}  // namespace
}  // namespace camber
