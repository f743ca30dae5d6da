#include "camber/detect/keypoint_network.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "camber/core/errors.h"

namespace camber {
namespace {

constexpr int kArea = 16 * 16;

/// Maps whose heatmaps are flat and low, with log sigma and logit 0.
struct Maps {
  std::vector<float> values = std::vector<float>(216 * kArea, 0.0F);

  /// Of a heatmap's cell, in 32 x 32.
  float& heat(int keypoint, int column, int row) {
    const int channel = 4 * keypoint + 2 * (row % 2) + column % 2;
    return values[static_cast<std::size_t>(channel * kArea + row / 2 * 16 + column / 2)];
  }
  float& log_sigma(int keypoint, int column, int row) {
    return values[static_cast<std::size_t>((144 + keypoint) * kArea + row * 16 + column)];
  }
  float& visible(int keypoint, int column, int row) {
    return values[static_cast<std::size_t>((180 + keypoint) * kArea + row * 16 + column)];
  }
};

TEST(DecodeKeypoints, TakesTheMeanAboutThePeak) {
  Maps maps;
  // Two cells of equal weight, columns 10 and 11 of row 7: their middles are 20.5 and 22.5, 14.5.
  maps.heat(3, 10, 7) = maps.heat(3, 11, 7) = 40.0F;
  // A far peak that is a little lower does not move it.
  maps.heat(4, 5, 5) = 30.0F;
  maps.heat(4, 25, 28) = 29.9F;
  const PredictedKeypoints out = decode_keypoints(maps.values.data(), {});
  EXPECT_NEAR(out[3].at.x(), 21.5, 1e-9);
  EXPECT_NEAR(out[3].at.y(), 14.5, 1e-9);
  EXPECT_NEAR(out[4].at.x(), 10.5, 1e-9);
  EXPECT_NEAR(out[4].at.y(), 10.5, 1e-9);
}

TEST(DecodeKeypoints, ReadsSigmaAndVisibilityWhereThePeakIs) {
  Maps maps;
  maps.heat(0, 20, 9) = 60.0F;
  maps.log_sigma(0, 10, 4) = std::log(2.0F);
  maps.visible(0, 10, 4) = 3.0F;
  maps.heat(1, 20, 9) = 60.0F;
  maps.visible(1, 10, 4) = -3.0F;
  KeypointsDescription description;
  description.visible_sigma_scale = 1.5;
  description.hidden_sigma_scale = 4.0;
  description.visibility_scale = 0.5;
  description.visibility_offset = 0.1;
  const PredictedKeypoints out = decode_keypoints(maps.values.data(), description);
  EXPECT_NEAR(out[0].sigma, 3.0, 1e-6);
  EXPECT_NEAR(out[0].visible, 1.0 / (1.0 + std::exp(-1.6)), 1e-6);
  EXPECT_NEAR(out[1].sigma, 4.0, 1e-6);
  EXPECT_NEAR(out[1].visible, 1.0 / (1.0 + std::exp(1.4)), 1e-6);
}

TEST(DecodeKeypoints, TwoPeaksFarApartWidenTheSigma) {
  Maps maps;
  maps.heat(0, 8, 16) = 50.0F;
  maps.heat(1, 8, 16) = maps.heat(1, 24, 16) = 50.0F;  // 32 px apart
  KeypointsDescription description;
  description.spread_weight = 1.0;
  const PredictedKeypoints out = decode_keypoints(maps.values.data(), description);
  EXPECT_NEAR(out[0].sigma, 0.5, 1e-6);  // the floor
  // 16^2 along u, 0 along v.
  EXPECT_NEAR(out[1].sigma, std::sqrt(0.5 * 256.0 + 0.25), 1e-6);
}

TEST(DecodeKeypoints, WhatIsNotFiniteIsNoKeypoint) {
  Maps maps;
  maps.heat(2, 3, 3) = std::numeric_limits<float>::quiet_NaN();
  const PredictedKeypoints out = decode_keypoints(maps.values.data(), {});
  EXPECT_TRUE(std::isnan(out[2].at.x()) && std::isnan(out[2].sigma));
  EXPECT_TRUE(out[1].at.allFinite());
}

TEST(DecodeKeypoints, AMirroredCropsMapsAreThoseOfTheOtherSide) {
  Maps maps, mirrored;
  maps.heat(3, 10, 7) = 40.0F;
  maps.log_sigma(3, 5, 3) = 0.6F;
  maps.visible(3, 5, 3) = 2.0F;
  // Column c is column 31 - c of the mirror image, left is right; there the peak is a cell lower.
  mirrored.heat(3 + 18, 31 - 10, 8) = 40.0F;
  mirrored.log_sigma(3 + 18, 15 - 5, 4) = 0.2F;
  mirrored.visible(3 + 18, 15 - 5, 4) = 1.0F;
  average_with_mirrored(mirrored.values.data(), maps.values.data());
  EXPECT_EQ(maps.heat(3, 10, 7), 20.0F);
  EXPECT_EQ(maps.heat(3, 10, 8), 20.0F);
  EXPECT_EQ(maps.heat(21, 10, 8), 0.0F);
  const PredictedKeypoints out = decode_keypoints(maps.values.data(), {});
  EXPECT_NEAR(out[3].at.x(), 20.5, 1e-6);
  EXPECT_NEAR(out[3].at.y(), 15.5, 1e-6);
  // Rows 3 and 4 of the output, each with half of the weight and half of its own.
  EXPECT_NEAR(std::log(out[3].sigma), 0.5 * (0.3 + 0.1), 1e-6);
  EXPECT_NEAR(out[3].visible, 1.0 / (1.0 + std::exp(-0.5 * (1.0 + 0.5))), 1e-6);
}

TEST(KeypointObservations, AreInTheImage) {
  PredictedKeypoints keypoints;
  keypoints[5] = {{31.5, 63.5}, 2.0, 0.75};
  const KeypointCrop crop = keypoint_crop({100.0, 50.0, 228.0, 150.0});
  const std::vector<KeypointObservation> out = to_observations(keypoints, crop);
  ASSERT_EQ(out.size(), 36U);
  EXPECT_NEAR(out[5].pixel.x(), 164.0, 1e-9);
  EXPECT_NEAR(out[5].pixel.y(), 100.0 + 0.5 * 1.15 * 128.0, 1e-9);
  EXPECT_NEAR(out[5].sigma, 2.0 * 1.15 * 2.0, 1e-9);
  EXPECT_EQ(out[5].confidence, 0.75);
}

TEST(KeypointNetwork, RefusesWhatIsNoNetwork) {
  KeypointsDescription description;
  description.input.width = description.input.height = 64;
  EXPECT_THROW(KeypointNetwork({"a.onnx", "no network"}, description), InputError);
  EXPECT_THROW(KeypointNetwork({"a.onnx", ""}, description), InputError);
  description.input.width = 128;
  EXPECT_THROW(KeypointNetwork({"a.onnx", ""}, description), std::invalid_argument);
  description.input.height = 128;
  EXPECT_THROW(KeypointNetwork({"a.onnx", ""}, description), InputError);
  description.input.width = description.input.height = 96;
  EXPECT_THROW(KeypointNetwork({"a.onnx", ""}, description), std::invalid_argument);
}

}  // namespace
}  // namespace camber
