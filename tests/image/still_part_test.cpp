#include "camber/image/still_part.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <stdexcept>
#include <vector>

namespace camber {
namespace {

constexpr int kWidth = 640, kHeight = 240, kTop = 60;
constexpr int kImages = 5, kStep = 23;  // px, that the road moves from image to image

/// Texture of some rms about 0, its grain a few pixels.
std::vector<double> texture(int rows, double rms, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> grain(static_cast<std::size_t>(rows) * kWidth);
  for (double& value : grain) value = normal(random);
  std::vector<double> out(grain.size());
  double power = 0.0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = grain[i] + grain[(i + 1) % grain.size()] + grain[(i + kWidth) % grain.size()];
    power += out[i] * out[i];
  }
  const double factor = rms / std::sqrt(power / static_cast<double>(out.size()));
  for (double& value : out) value *= factor;
  return out;
}

/// Images of a texture that moves down the picture over one that stands still.
std::vector<GrayImage> film(double moving_rms, double still_rms) {
  const std::vector<double> still = texture(kHeight, still_rms, 1);
  const std::vector<double> moving = texture(kHeight + kImages * kStep, moving_rms, 2);
  std::vector<GrayImage> out;
  for (int k = 0; k < kImages; ++k) {
    GrayImage image{kWidth, kHeight, std::vector<std::uint8_t>(kWidth * kHeight)};
    const auto shift = static_cast<std::size_t>((kImages - k) * kStep) * kWidth;
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
      image.pixels[i] = static_cast<std::uint8_t>(
          std::lround(std::clamp(110.0 + still[i] + moving[i + shift], 0.0, 255.0)));
    }
    out.push_back(std::move(image));
  }
  return out;
}

StillPart still_part_of(const std::vector<GrayImage>& images) {
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : images) pointers.push_back(&image);
  return still_part(pointers, kTop);
}

/// Correlation of the rows below the top of two images, the second read some rows farther down.
double correlation(const GrayImage& a, const GrayImage& b, int down) {
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int v = kTop; v + down < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const double x = a.row(v)[u], y = b.row(v + down)[u];
      ++n;
      sa += x;
      sb += y;
      saa += x * x;
      sbb += y * y;
      sab += x * y;
    }
  }
  return (n * sab - sa * sb) / std::sqrt((n * saa - sa * sa) * (n * sbb - sb * sb));
}

TEST(StillPart, ARoadThatMovesHasHardlyAny) {
  const std::vector<GrayImage> images = film(8.0, 0.0);
  const StillPart still = still_part_of(images);
  EXPECT_LT(still.share, 0.1);
  const GrayImage left = without(still, images[2]);
  EXPECT_GT(correlation(images[2], left, 0), 0.98);
}

TEST(StillPart, WhatTheCoderRepeatsIsTakenOffAndWhatMovesIsFoundAgain) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  const StillPart still = still_part_of(images);
  EXPECT_GT(still.share, 0.6);
  // Before, the images agree where they stand still; after, where the road has gone.
  EXPECT_GT(correlation(images[1], images[2], 0), 2.0 * correlation(images[1], images[2], kStep));
  const GrayImage a = without(still, images[1]), b = without(still, images[2]);
  EXPECT_GT(correlation(a, b, kStep), 0.5);
  EXPECT_LT(correlation(a, b, 0), 0.1);
}

TEST(StillPart, RowsAboveTheTopAreKept) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  const GrayImage left = without(still_part_of(images), images[0]);
  EXPECT_TRUE(std::equal(left.pixels.begin(), left.pixels.begin() + kTop * kWidth,
                         images[0].pixels.begin()));
}

TEST(StillPart, OneImageHasNone) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  const StillPart still = still_part({&images[0]}, kTop);
  EXPECT_EQ(still.share, 0.0);
  EXPECT_EQ(without(still, images[0]).pixels, images[0].pixels);
}

TEST(StillPart, OtherInputIsRefused) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  const GrayImage small{4, 4, std::vector<std::uint8_t>(16)};
  EXPECT_THROW(still_part({}, 0), std::invalid_argument);
  EXPECT_THROW(still_part({&images[0], &small}, 0), std::invalid_argument);
  EXPECT_THROW(still_part({&images[0]}, kHeight), std::invalid_argument);
}

}  // namespace
}  // namespace camber
