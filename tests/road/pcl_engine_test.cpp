// PCL's answers to the questions of fit_road_surface and segment_ground.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/road/pcl/morphological_ground.h"
#include "camber/road/pcl/region_growing.h"
#include "road/scan_maker.h"

#if defined(__SANITIZE_ADDRESS__)
/// Debian's PCL allocates by malloc what its headers here free by delete.
extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "alloc_dealloc_mismatch=0"; }
#endif

namespace camber {
namespace {

using ::testing::HasSubstr;

/// 40 m of road, level and then rising by 20 %, beside a wall; noise of 5 mm. z up, at an origin.
RoadCloud creased_road() {
  const CounterRandom random(5);
  RoadCloud cloud;
  cloud.origin = Eigen::Vector3d(1000.0, 2000.0, 300.0);
  for (std::uint64_t i = 0; i < 8000; ++i) {
    const double x = random.uniform(3 * i, 0.0, 40.0), y = random.uniform(3 * i + 1, -3.0, 3.0);
    const double noise = 0.005 * random.normal(i);
    if (i % 8 == 0) {
      cloud.points.emplace_back(static_cast<float>(x), static_cast<float>(5.0 + noise),
                                static_cast<float>(0.5 + std::abs(y)));
    } else {
      cloud.points.emplace_back(static_cast<float>(x), static_cast<float>(y),
                                static_cast<float>(0.2 * std::max(0.0, x - 20.0) + noise));
    }
  }
  cloud.points[100].x() = std::numeric_limits<float>::quiet_NaN();
  return cloud;
}

TEST(RegionGrowingPcl, FindsBothSidesOfACreaseAndNoWall) {
  const RoadCloud cloud = creased_road();
  const RoadSurfaceFit fit = fit_road_surface_pcl(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  const auto& patches = fit.surface.patches;
  ASSERT_GE(patches.size(), 2u);
  EXPECT_GE(patches[0].inliers, patches[1].inliers);
  double low = 1.0, high = 0.0;
  for (const PlanePatch& patch : {patches[0], patches[1]}) {
    const double tilt = angle_between(patch.plane.plane.normal, Eigen::Vector3d::UnitZ());
    low = std::min(low, tilt);
    high = std::max(high, tilt);
    EXPECT_NEAR(patch.noise, 0.005, 0.001);
    EXPECT_NEAR(patch.plane.plane.signed_distance(patch.plane.centroid), 0.0, 1e-9);
    EXPECT_LT(std::sqrt(patch.plane.covariance(2, 2)), 0.001);
    EXPECT_NEAR(patch.plane.centroid.x(), 1020.0, 15.0);  // true coordinates
  }
  EXPECT_LT(low, 0.003);
  EXPECT_NEAR(high, std::atan(0.2), 0.003);
  ASSERT_EQ(fit.labels.size(), cloud.size());
  EXPECT_EQ(fit.labels[100], -1);
  int on_wall = 0;
  for (std::size_t i = 0; i < cloud.size(); i += 8) on_wall += fit.labels[i] >= 0;
  EXPECT_EQ(on_wall, 0);
  const auto both =
      std::count_if(fit.labels.begin(), fit.labels.end(), [](int l) { return l >= 0; });
  EXPECT_GT(both, 6000);
  // Queries answer on them, and the two are neighbours.
  const SurfaceQuery query = fit.surface.query({1010.0, 2000.0, 300.0});
  EXPECT_NEAR(query.point.z(), 300.0, 0.01);
  EXPECT_FALSE(fit.surface.links.empty());
}

TEST(RegionGrowingPcl, SaysWhatItCannotAnswer) {
  RoadCloud two;
  two.points = {{0, 0, 0}, {1, 0, 0}};
  EXPECT_EQ(fit_road_surface_pcl(two, {}).status, Status::kFailed);
  RegionGrowingOptions options;
  options.max_angle = 0.0;
  EXPECT_THROW(fit_road_surface_pcl(creased_road(), {}, options), std::invalid_argument);
}

TEST(MorphologicalGroundPcl, AgreesOnAFlatStreet) {
  test::ScanOptions made;
  made.azimuths = 240;
  test::Scan scan = test::make_scan(made);
  // What lies far below the ground is ground to an opening.
  std::vector<int> kept, truth;
  for (std::size_t i = 0; i < scan.cloud.size(); ++i) {
    if (scan.height[i] < -0.5f) continue;
    kept.push_back(static_cast<int>(i));
    truth.push_back(scan.ground[i]);
  }
  RoadCloud cloud = scan.cloud.select(kept);
  const GroundSegmentation found = segment_ground_pcl(cloud);
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  EXPECT_EQ(found.cell, 0.5);
  const test::GroundScore score = test::score_ground(truth, found.labels);
  EXPECT_GT(score.precision, 0.75);
  EXPECT_GT(score.recall, 0.9);
  // The same on its side.
  GroundOptions aside;
  aside.up = Eigen::Vector3d(0, -1, 0);
  for (Eigen::Vector3f& p : cloud.points) p = Eigen::Vector3f(p.x(), -p.z(), p.y());
  EXPECT_GT(test::score_ground(truth, segment_ground_pcl(cloud, aside).labels).recall, 0.9);
}

TEST(MorphologicalGroundPcl, RefusesAGridThatIsTooLarge) {
  RoadCloud cloud;
  cloud.points = {{0, 0, 0}, {5000, 5000, 0}, {std::nanf(""), 0, 0}};
  const GroundSegmentation found = segment_ground_pcl(cloud);
  EXPECT_EQ(found.status, Status::kFailed);
  EXPECT_THAT(found.reason, HasSubstr("a larger cell is needed"));
  EXPECT_EQ(segment_ground_pcl(RoadCloud()).status, Status::kFailed);
}

}  // namespace
}  // namespace camber
