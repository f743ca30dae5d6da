#include "camber/plane/dominant_plane_pcl.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

/// Points of a plane with noise, then points anywhere in the box above it.
std::vector<Eigen::Vector3d> points_of(const Plane& plane, int on, int off, double noise) {
  const CounterRandom random(5);
  std::uint64_t counter = 0;
  std::vector<Eigen::Vector3d> out;
  for (int i = 0; i < on + off; ++i) {
    const double x = random.uniform(counter++, -3.0, 3.0);
    const double z = random.uniform(counter++, 8.0, 20.0);
    const double above =
        i < on ? noise * random.normal(counter) : random.uniform(counter, 0.3, 3.0);
    ++counter;
    const Eigen::Vector3d place(x, 0.0, z);
    out.push_back(plane.foot(place) + above * plane.normal);
  }
  return out;
}

TEST(DominantPlanePcl, IsFoundAmongOutliers) {
  const Plane truth{Eigen::Vector3d(0.05, -1.0, -0.15).normalized(), 1.6};
  const std::vector<Eigen::Vector3d> points = points_of(truth, 300, 200, 0.01);
  const DominantPlane found = dominant_plane_pcl(points, {});
  ASSERT_EQ(found.status, Status::kOk);
  EXPECT_LT(angle_between(found.plane.normal, truth.normal), 2e-3);  // 0.01 m over 300 points
  EXPECT_NEAR(found.plane.signed_distance(truth.foot({0.0, 1.6, 14.0})), 0.0, 5e-3);
  EXPECT_GE(found.inliers.size(), 295u);
  EXPECT_LE(found.inliers.back(), 299);
  const DominantPlane again = dominant_plane_pcl(points, {});
  EXPECT_EQ(found.plane.normal, again.plane.normal);
  EXPECT_EQ(found.inliers, again.inliers);
}

TEST(DominantPlanePcl, KeepsToTheWantedDirection) {
  // A wall has most points.
  const CounterRandom random(6);
  std::vector<Eigen::Vector3d> points;
  for (std::uint64_t i = 0; i < 600; ++i) {
    points.emplace_back(-3.0, random.uniform(2 * i, -3.0, 1.6),
                        random.uniform(2 * i + 1, 8.0, 20.0));
  }
  const Plane road{{0.0, -1.0, 0.0}, 1.6};
  for (const Eigen::Vector3d& p : points_of(road, 200, 0, 0.005)) points.push_back(p);
  const DominantPlane found = dominant_plane_pcl(points, {});
  ASSERT_EQ(found.status, Status::kOk);
  EXPECT_LT(angle_between(found.plane.normal, road.normal), 5e-3);
  EXPECT_GT(found.plane.normal.dot(Eigen::Vector3d(0.0, -1.0, 0.0)), 0.99);
}

TEST(DominantPlanePcl, TooFewPointsAndBadOptions) {
  EXPECT_EQ(dominant_plane_pcl({{0, 1, 5}, {1, 1, 5}}, {}).status, Status::kFailed);
  DominantPlaneOptions options;
  options.inlier_threshold = 0.0;
  EXPECT_THROW(dominant_plane_pcl({}, options), std::invalid_argument);
  options = {};
  options.max_tilt = 2.0;
  EXPECT_THROW(dominant_plane_pcl({}, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
