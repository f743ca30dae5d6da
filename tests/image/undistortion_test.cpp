#include "camber/image/undistortion.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <stdexcept>

#include "camber/geometry/lens_map.h"
#include "camber/image/frame_masks.h"

namespace camber {
namespace {

const PinholeCamera kRaw{320, 200, 180.0, 181.0, 158.0, 99.0};

LensDistortion lens(LensModel model, std::vector<double> coefficients) {
  LensDistortion out;
  out.model = model;
  out.coefficients = std::move(coefficients);
  out.raw = kRaw;
  return out;
}

// OpenCV's own projection of the same rays.
TEST(Undistortion, PixelsAreThoseOfOpenCv) {
  const cv::Matx33d k(kRaw.fx, 0, kRaw.cx, 0, kRaw.fy, kRaw.cy, 0, 0, 1);
  for (const LensDistortion& l :
       {lens(LensModel::kBrown, {-0.31, 0.12, 0.0008, -0.0005, -0.02}),
        lens(LensModel::kBrown, {0.5, -0.1, 0.0004, 0.0003, 0.01, 0.85, 0.02, 0.001}),
        lens(LensModel::kFisheye, {0.02, -0.01, 0.003, -0.001})}) {
    const PinholeCamera camera = undistorted_camera(l);
    const LensMap map(camera, l);
    std::vector<cv::Point3d> rays;
    std::vector<Eigen::Vector2d> ours;
    for (int v = 0; v < camera.height; v += 9) {
      for (int u = 0; u < camera.width; u += 9) {
        const auto raw = map.raw_from_pinhole({u, v});
        if (!raw) continue;
        const Eigen::Vector3d ray = camera.ray({u, v});
        rays.emplace_back(ray.x(), ray.y(), ray.z());
        ours.push_back(*raw);
      }
    }
    ASSERT_GT(rays.size(), 300u);
    std::vector<cv::Point2d> theirs;
    const cv::Vec3d zero(0, 0, 0);
    if (l.model == LensModel::kFisheye) {
      cv::fisheye::projectPoints(rays, theirs, zero, zero, k, l.coefficients);
    } else {
      cv::projectPoints(rays, zero, zero, k, l.coefficients, theirs);
    }
    for (std::size_t i = 0; i < rays.size(); ++i) {
      EXPECT_NEAR(ours[i].x(), theirs[i].x, 1e-6);
      EXPECT_NEAR(ours[i].y(), theirs[i].y, 1e-6);
    }
  }
}

// A picture of the camera's own coordinates comes back as they are.
TEST(Undistortion, TakesTheLensOut) {
  const LensDistortion l = lens(LensModel::kBrown, {-0.3, 0.08, 0.0, 0.0});
  PinholeCamera camera = undistorted_camera(l);
  camera.width += 160;  // more than the file shows
  camera.cx += 80.0;
  const LensMap map(camera, l);
  Image file{kRaw.width, kRaw.height, 3, {}};
  Image stripes{kRaw.width, kRaw.height, 1, {}};
  for (int v = 0; v < kRaw.height; ++v) {
    for (int u = 0; u < kRaw.width; ++u) {
      const auto at = map.pinhole_from_raw({u, v});
      ASSERT_TRUE(at);
      file.data.push_back(static_cast<std::uint8_t>(std::lround(40 + 0.2 * at->x())));
      file.data.push_back(static_cast<std::uint8_t>(std::lround(40 + 0.2 * at->y())));
      file.data.push_back(77);
      stripes.data.push_back(at->x() < 0.5 * camera.width ? 1 : 2);
    }
  }
  const Undistortion undistortion(camera, l);
  ASSERT_TRUE(undistortion.needed());
  const Image out = undistortion.image(file);
  const Image labels = undistortion.labels(stripes);
  ASSERT_EQ(out.width, camera.width);
  ASSERT_EQ(labels.height, camera.height);
  int shown = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * camera.width + u;
      if (undistortion.outside()[i]) continue;
      ++shown;
      EXPECT_NEAR(out.data[3 * i], 40 + 0.2 * u, 1.1);  // rounded twice
      EXPECT_NEAR(out.data[3 * i + 1], 40 + 0.2 * v, 1.1);
      EXPECT_EQ(out.data[3 * i + 2], 77);
      if (std::abs(u - 0.5 * camera.width) > 2) {
        EXPECT_EQ(labels.data[i], u < 0.5 * camera.width ? 1 : 2);
      }
    }
  }
  EXPECT_GT(shown, 0.6 * camera.width * camera.height);
  EXPECT_EQ(out.data[0], 0);  // a corner that the file does not show
  EXPECT_EQ(labels.data[0], 0);
  EXPECT_NE(undistortion.outside()[0], 0);
}

// What the lens does not show is neither ground nor compared: it counts as a vehicle does.
TEST(Undistortion, WhatIsHiddenIsNoGround) {
  const PinholeCamera camera{40, 20, 30.0, 30.0, 20.0, 10.0};
  MaskInputs inputs;
  inputs.hidden.assign(800, 0);
  inputs.hidden[10 * 40 + 5] = 1;
  for (const bool with_mask : {false, true}) {
    if (with_mask) inputs.road_mask = Image{40, 20, 1, std::vector<std::uint8_t>(800, 255)};
    const FrameMasks masks = make_frame_masks(camera, inputs);
    for (const std::size_t near : {10u * 40 + 5, 10u * 40 + 8}) {  // a margin of 3 px
      EXPECT_EQ(masks.ground[near], 0);
      EXPECT_EQ(masks.roadway[near], 0);
      EXPECT_NE(masks.vehicle[near], 0);
    }
    EXPECT_NE(masks.ground[10 * 40 + 20], 0);
    EXPECT_EQ(masks.vehicle[10 * 40 + 20], 0);
  }
  inputs.hidden.resize(3);
  EXPECT_THROW(make_frame_masks(camera, inputs), std::invalid_argument);
}

TEST(Undistortion, IsNothingWithoutALens) {
  const Undistortion none(kRaw), of_scene(kRaw, LensDistortion{});
  EXPECT_FALSE(none.needed());
  EXPECT_FALSE(of_scene.needed());
  EXPECT_TRUE(none.outside().empty());
  Image file{2, 1, 1, {3, 4}};
  EXPECT_EQ(none.image(file).data, file.data);
  const Undistortion lensed(kRaw, lens(LensModel::kBrown, {-0.3, 0.0, 0.0, 0.0}));
  EXPECT_THROW(lensed.image(file), std::invalid_argument);
}

}  // namespace
}  // namespace camber
