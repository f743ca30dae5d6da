// Patches of large clouds: squares of the plan apart from each other, then joined.

#include "camber/road/detail/patch_blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>

#include "camber/core/random.h"
#include "camber/road/fit_road_surface.h"

namespace camber {
namespace {

using Eigen::Vector3d;

constexpr double kNoise = 0.02;                      // m
const Vector3d kCorner(651008.0, 6270016.0, 100.0);  // x: a multiple of a square's side

/// Points drawn evenly over [0, width) x [0, depth), m from the corner.
RoadCloud made_ground(double width, double depth, double density,
                      const std::function<double(double, double)>& height) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  cloud.origin = kCorner;
  const CounterRandom random(5);
  const auto count = static_cast<std::uint64_t>(width * depth * density);
  for (std::uint64_t i = 0; i < count; ++i) {
    const double x = random.uniform(2 * i, 0.0, width), y = random.uniform(2 * i + 1, 0.0, depth);
    const double z = height(x, y) + kNoise * random.normal(i);
    // Whole millimetres, as surveys have them.
    cloud.points.push_back(Vector3d(std::round(1000 * x) / 1000, std::round(1000 * y) / 1000,
                                    std::round(1000 * z) / 1000)
                               .cast<float>());
  }
  return cloud;
}

/// Points on each patch.
std::map<int, std::size_t> counts_of(const std::vector<int>& labels) {
  std::map<int, std::size_t> out;
  for (const int label : labels) ++out[label];
  return out;
}

TEST(PatchBlocks, APlaneOverManyBlocksIsOnePatchAsWellKnownAsItsPointsMakeIt) {
  const auto plane = [](double x, double y) { return 0.03 * x - 0.02 * y; };
  const RoadCloud cloud = made_ground(230.0, 150.0, 10.0, plane);
  ASSERT_GT(cloud.size(), 262144u);
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  ASSERT_EQ(fit.surface.patches.size(), 1u);
  EXPECT_GT(counts_of(fit.labels)[0], 0.98 * static_cast<double>(cloud.size()));
  const UncertainPlane& found = fit.surface.patches[0].plane;
  // By n points of the noise: height sigma / sqrt(n), tilt that over their spread.
  const double n = static_cast<double>(cloud.size()), height = kNoise / std::sqrt(n);
  EXPECT_GT(std::sqrt(found.covariance(2, 2)), 0.9 * height);
  for (const double x : {10.0, 115.0, 220.0}) {
    for (const double y : {10.0, 140.0}) {
      const Vector3d truth = kCorner + Vector3d(x, y, plane(x, y));
      const double sigma = std::sqrt(found.height_variance(truth));
      EXPECT_LT(std::abs(found.plane.signed_distance(truth)), 4.0 * sigma) << x << " " << y;
      EXPECT_LT(sigma, 0.001) << x << " " << y;
    }
  }
}

TEST(PatchBlocks, AStepOnABordersLineIsNotJoined) {
  constexpr double kBorder = detail::kBlockSide;
  ASSERT_EQ(std::fmod(kCorner.x(), kBorder), 0.0);
  const RoadCloud cloud =
      made_ground(230.0, 150.0, 10.0, [](double x, double) { return x < kBorder ? 0.0 : 0.15; });
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  ASSERT_EQ(fit.surface.patches.size(), 2u);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int side = double{cloud.points[i].x()} < kBorder ? 0 : 1;
    wrong += fit.labels[i] >= 0 && fit.labels[i] != side ? 1 : 0;
  }
  EXPECT_LT(wrong, cloud.size() / 1000);
}

TEST(PatchBlocks, HangNeitherOnOrderNorOriginNorThreads) {
  const RoadCloud cloud = made_ground(230.0, 150.0, 10.0, [](double x, double y) {
    return 4.0 * std::sin(x / 40.0) + 0.5 * std::cos(y / 25.0);
  });
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  EXPECT_GT(fit.surface.patches.size(), 20u);
  std::vector<int> order(cloud.size());
  std::iota(order.begin(), order.end(), 0);
  const CounterRandom random(9);
  std::stable_sort(order.begin(), order.end(), [&](int l, int r) {
    return random.uniform(static_cast<std::uint64_t>(l)) <
           random.uniform(static_cast<std::uint64_t>(r));
  });
  RoadCloud other = cloud.select(order);
  other.origin -= Vector3d(3.0, 7.0, 2.0);
  for (Eigen::Vector3f& p : other.points) p += Eigen::Vector3f(3.0f, 7.0f, 2.0f);
  RoadSurfaceOptions options;
  options.num_threads = 1;
  const RoadSurfaceFit again = fit_road_surface(other, options);
  ASSERT_EQ(again.surface.patches.size(), fit.surface.patches.size());
  std::size_t differing = 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    differing += again.labels[k] != fit.labels[static_cast<std::size_t>(order[k])] ? 1 : 0;
  }
  EXPECT_EQ(differing, 0u);
  for (std::size_t k = 0; k < fit.surface.patches.size(); ++k) {
    EXPECT_EQ(again.surface.patches[k].plane.plane.normal,
              fit.surface.patches[k].plane.plane.normal);
    EXPECT_EQ(again.surface.patches[k].plane.covariance, fit.surface.patches[k].plane.covariance);
  }
}

}  // namespace
}  // namespace camber
