#include "camber/plane/fit_plane_pcl.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "camber/core/random.h"

namespace camber {
namespace {

using Eigen::Vector3d;

constexpr double kNoise = 0.02;  // m

/// A tilted plane with normal noise among outliers. @param share  of outliers
RoadCloud plane_among_outliers(std::uint64_t seed, double share, Plane* truth) {
  const CounterRandom random(seed, 3);
  const Vector3d normal =
      Vector3d(random.uniform(0, -0.3, 0.3), random.uniform(1, -0.3, 0.3), 1.0).normalized();
  *truth = Plane::through({0.0, 0.0, 2.0}, normal);
  RoadCloud cloud;
  for (std::uint64_t i = 1; i <= 3000; ++i) {
    const double x = random.uniform(4 * i, -10.0, 10.0), y = random.uniform(4 * i + 1, -10.0, 10.0);
    const double z =
        2.0 - (normal.x() * x + normal.y() * y - kNoise * random.normal(i)) / normal.z();
    const bool outlier = random.uniform(4 * i + 2) < share;
    cloud.points.push_back(
        Vector3d(x, y, outlier ? random.uniform(4 * i + 3, -8.0, 12.0) : z).cast<float>());
  }
  return cloud;
}

TEST(FitPlanePcl, FindsPlanesAmongOutliersWhateverTheFirstSample) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Plane truth;
    const RoadCloud cloud =
        plane_among_outliers(seed, 0.1 + 0.005 * static_cast<double>(seed), &truth);
    PlaneFitOptions options;
    options.seed = seed;
    const PlaneFit fit = fit_plane_pcl(cloud, options);
    ASSERT_EQ(fit.status, Status::kOk) << seed << ": " << fit.reason;
    EXPECT_LT(angle_between(fit.plane.plane.normal, truth.normal), 1e-3) << seed;
    EXPECT_NEAR(truth.signed_distance(fit.plane.centroid), 0.0, 3e-3) << seed;
    EXPECT_NEAR(fit.noise, kNoise, 0.1 * kNoise) << seed;  // 1.5 % of it is a standard deviation
  }
}

TEST(FitPlanePcl, NoiseDoesNotFollowTheThreshold) {
  Plane truth;
  const RoadCloud cloud = plane_among_outliers(3, 0.0, &truth);
  for (const double threshold : {1.5 * kNoise, 2.5 * kNoise, 5.0 * kNoise}) {
    PlaneFitOptions options;
    options.inlier_threshold = threshold;
    EXPECT_NEAR(fit_plane_pcl(cloud, options).noise, kNoise, 0.05 * kNoise) << threshold;
  }
}

TEST(FitPlanePcl, DrawsBySeed) {
  Plane truth;
  const RoadCloud cloud = plane_among_outliers(3, 0.3, &truth);
  PlaneFitOptions options;
  const PlaneFit first = fit_plane_pcl(cloud, options);
  EXPECT_EQ(first.plane.plane.normal, fit_plane_pcl(cloud, options).plane.plane.normal);
  bool differs = false;
  for (options.seed = 1; options.seed < 5; ++options.seed) {
    differs =
        differs || fit_plane_pcl(cloud, options).plane.plane.normal != first.plane.plane.normal;
  }
  EXPECT_TRUE(differs);
}

TEST(FitPlanePcl, AWallIsNoPlaneNearLevel) {
  const CounterRandom random(8);
  RoadCloud cloud;
  for (std::uint64_t i = 0; i < 500; ++i) {
    cloud.points.emplace_back(static_cast<float>(random.uniform(2 * i, -10.0, 10.0)), 0.0f,
                              static_cast<float>(random.uniform(2 * i + 1, 0.0, 5.0)));
  }
  const PlaneFit fit = fit_plane_pcl(cloud, {});
  EXPECT_EQ(fit.status, Status::kFailed);
  EXPECT_EQ(fit.reason, "no plane within 0.7 rad of the up direction");
}

TEST(FitPlanePcl, FewPlacesCarryNoCovariance) {
  const Eigen::Vector3f a(0, 0, 1), b(3, 0, 1), c(0, 4, 1.5f);
  RoadCloud cloud;
  cloud.points.assign(20, a);
  EXPECT_EQ(fit_plane_pcl(cloud, {}).reason, "all points lie at one place");
  cloud.points.insert(cloud.points.end(), 20, b);
  EXPECT_EQ(fit_plane_pcl(cloud, {}).status, Status::kFailed);
  EXPECT_EQ(fit_plane_pcl(cloud, {}).reason, "the points lie on a line");
  cloud.points.insert(cloud.points.end(), 20, c);
  const PlaneFit fit = fit_plane_pcl(cloud, {});
  EXPECT_EQ(fit.status, Status::kWeak);
  EXPECT_EQ(fit.reason, "only 3 points lie on the plane");
  EXPECT_GE(fit.plane.covariance.diagonal().minCoeff(), 1.0);
}

}  // namespace
}  // namespace camber
