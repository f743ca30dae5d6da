#include "camber/import/depth_cloud.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

TEST(CloudFromDepth, KnownPixelsRowByRow) {
  const PinholeCamera camera{3, 2, 100.0, 50.0, 1.0, 0.5};
  DepthImage depth{3, 2, {2.0f, NAN, 4.0f, 8.0f, 1.0f, 100.0f}};
  Image color{3, 2, 3, {}}, labels{3, 2, 1, {5, 6, 7, 8, 9, 10}};
  for (int i = 0; i < 18; ++i) color.data.push_back(static_cast<std::uint8_t>(10 * i));
  const RoadCloud cloud = cloud_from_depth(depth, camera, &color, &labels, 50.0);
  ASSERT_EQ(cloud.size(), 4u);
  EXPECT_EQ(cloud.frame, CloudFrame::kCamera);
  EXPECT_EQ(cloud.labels.at("class"), (std::vector<int>{5, 7, 8, 9}));
  EXPECT_EQ(cloud.colors[1], (std::array<std::uint8_t, 3>{60, 70, 80}));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    // Back to the pixel it came from.
    const auto pixel = camera.project(cloud.points[i].cast<double>());
    ASSERT_TRUE(pixel.has_value());
    const int u = static_cast<int>(std::lround(pixel->x())),
              v = static_cast<int>(std::lround(pixel->y()));
    EXPECT_NEAR(pixel->x(), u, 1e-5);
    EXPECT_NEAR(pixel->y(), v, 1e-5);
    EXPECT_EQ(depth.metres[static_cast<std::size_t>(3 * v + u)], cloud.points[i].z());
  }
  EXPECT_TRUE(cloud_from_depth(depth, camera).labels.empty());
  EXPECT_EQ(cloud_from_depth(depth, camera).size(), 5u);
  const PinholeCamera other{4, 2, 100.0, 50.0, 1.0, 0.5};
  EXPECT_THROW(cloud_from_depth(depth, other), std::invalid_argument);
  labels.width = 2;
  EXPECT_THROW(cloud_from_depth(depth, camera, nullptr, &labels), std::invalid_argument);
}

}  // namespace
}  // namespace camber
