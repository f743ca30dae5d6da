#include "camber/geometry/pinhole_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <limits>

namespace camber {
namespace {

PinholeCamera kitti() {
  PinholeCamera camera;
  camera.width = 1242;
  camera.height = 375;
  camera.fx = 721.5377;
  camera.fy = 700.0;
  camera.cx = 609.5593;
  camera.cy = 172.854;
  return camera;
}

TEST(PinholeCamera, ProjectsByHand) {
  const auto pixel = kitti().project({2.0, 1.0, 10.0});
  ASSERT_TRUE(pixel.has_value());
  EXPECT_NEAR(pixel->x(), 144.30754 + 609.5593, 1e-10);
  EXPECT_NEAR(pixel->y(), 70.0 + 172.854, 1e-10);
  EXPECT_FALSE(kitti().project({1, 1, 0}).has_value());
  EXPECT_FALSE(kitti().project({1, 1, -1}).has_value());
  EXPECT_FALSE(kitti().project({1, 1, std::nan("")}).has_value());
}

TEST(PinholeCamera, RayInvertsProjection) {
  const PinholeCamera camera = kitti();
  for (const double z : {0.5, 3.0, 80.0}) {
    const Eigen::Vector3d x(-2.5, 1.6, z);
    const Eigen::Vector3d ray = camera.ray(*camera.project(x));
    EXPECT_EQ(ray.z(), 1.0);
    EXPECT_LT((z * ray - x).norm(), 1e-12 * z);
    EXPECT_LT((camera.matrix() * x / z - camera.project(x)->homogeneous()).norm(), 1e-10);
  }
}

TEST(PinholeCamera, ContainsTheCentresOfItsPixels) {
  const PinholeCamera camera = kitti();
  EXPECT_TRUE(camera.contains({0.0, 0.0}));
  EXPECT_TRUE(camera.contains({1241.0, 374.0}));
  EXPECT_FALSE(camera.contains({1241.01, 374.0}));
  EXPECT_FALSE(camera.contains({-0.01, 10.0}));
  EXPECT_FALSE(camera.contains({1.9, 10.0}, 2.0));
  EXPECT_TRUE(camera.contains({2.0, 372.0}, 2.0));
  EXPECT_FALSE(camera.contains({std::nan(""), 10.0}));
}

TEST(PinholeCamera, ValidateNamesTheBadField) {
  kitti().validate();
  const auto message = [](const PinholeCamera& camera) -> std::string {
    try {
      camera.validate();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  PinholeCamera camera = kitti();
  camera.width = 0;
  EXPECT_EQ(message(camera), "width = 0, expected a positive number of pixels");
  camera = kitti();
  camera.height = -3;
  EXPECT_THAT(message(camera), ::testing::StartsWith("height = -3"));
  camera = kitti();
  camera.fx = std::numeric_limits<double>::infinity();
  EXPECT_THAT(message(camera), ::testing::StartsWith("fx = inf"));
  camera = kitti();
  camera.fy = 0.0;
  EXPECT_THAT(message(camera), ::testing::StartsWith("fy = 0"));
  camera = kitti();
  camera.cx = std::nan("");
  EXPECT_THAT(message(camera), ::testing::StartsWith("cx = nan"));
  camera = kitti();
  camera.cy = std::nan("");
  EXPECT_THAT(message(camera), ::testing::StartsWith("cy = nan"));
}

}  // namespace
}  // namespace camber
