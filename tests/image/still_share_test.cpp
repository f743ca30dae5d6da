#include "camber/image/still_share.h"

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

double share_of(const std::vector<GrayImage>& images) {
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : images) pointers.push_back(&image);
  return still_share(pointers, kTop);
}

TEST(StillShare, ARoadThatMovesHasHardlyAny) { EXPECT_LT(share_of(film(8.0, 0.0)), 0.1); }

TEST(StillShare, IsThatOfTheVarianceWhichTheCoderRepeats) {
  EXPECT_NEAR(share_of(film(6.0, 6.0)), 0.5, 0.15);
  EXPECT_NEAR(share_of(film(3.0, 9.0)), 0.9, 0.1);
}

TEST(StillShare, RowsAboveTheTopDoNotCount) {
  std::vector<GrayImage> images = film(6.0, 6.0);
  const double share = share_of(images);
  for (GrayImage& image : images) {
    std::fill(image.pixels.begin(), image.pixels.begin() + kTop * kWidth, std::uint8_t{0});
  }
  EXPECT_EQ(share_of(images), share);
}

TEST(StillShare, OneImageHasNone) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  EXPECT_EQ(still_share({&images[0]}, kTop), 0.0);
}

TEST(StillShare, OtherInputIsRefused) {
  const std::vector<GrayImage> images = film(3.0, 9.0);
  const GrayImage small{4, 4, std::vector<std::uint8_t>(16)};
  EXPECT_THROW(still_share({}, 0), std::invalid_argument);
  EXPECT_THROW(still_share({&images[0], &small}, 0), std::invalid_argument);
  EXPECT_THROW(still_share({&images[0]}, kHeight), std::invalid_argument);
}

}  // namespace
}  // namespace camber
