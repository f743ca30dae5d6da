#include "camber/image/detail/cubic_sampling.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace camber::detail {
namespace {

constexpr int kWidth = 7, kHeight = 6;

std::vector<float> ramp() {
  std::vector<float> out;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) out.push_back(3.0F + 2.0F * x - 5.0F * y);
  }
  return out;
}

float sampled(const std::vector<float>& image, float x, float y) {
  const float outside = -1000.0F;
  float out = 0.0F;
  sample_cubic({image.data(), kWidth, kWidth, kHeight}, -0.75F, 1, &x, &y, &outside, &out);
  return out;
}

TEST(CubicSampling, ReproducesPixels) {
  const std::vector<float> image = ramp();
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_EQ(sampled(image, static_cast<float>(x), static_cast<float>(y)),
                image[static_cast<std::size_t>(y * kWidth + x)]);
    }
  }
  // Halfway between pixels a plane is met, too.
  EXPECT_NEAR(sampled(image, 2.5F, 1.5F), 3.0 + 2.0 * 2.5 - 5.0 * 1.5, 1e-5);
}

TEST(CubicSampling, WeighsAPointAsTheConvolutionDoes) {
  std::vector<float> image(kWidth * kHeight, 0.0F);
  image[2 * kWidth + 3] = 1.0F;
  // (a + 2) t^3 - (a + 3) t^2 + 1 with a = -0.75 at t = 0.25; a (t^3 - 5 t^2 + 8 t - 4) at 1.25.
  EXPECT_NEAR(sampled(image, 3.25F, 2.0F), 0.87890625, 1e-6);
  EXPECT_NEAR(sampled(image, 4.25F, 2.0F), -0.10546875, 1e-6);
}

TEST(CubicSampling, RepeatsTheRimAndLeavesOutWhatLiesBeyond) {
  const std::vector<float> flat(kWidth * kHeight, 40.0F);
  EXPECT_NEAR(sampled(flat, 0.4F, 0.2F), 40.0, 1e-5);
  EXPECT_NEAR(sampled(flat, kWidth - 1.2F, kHeight - 1.4F), 40.0, 1e-5);
  EXPECT_EQ(sampled(flat, -0.1F, 2.0F), -1000.0F);
  EXPECT_EQ(sampled(flat, 2.0F, kHeight - 0.9F), -1000.0F);
  EXPECT_EQ(sampled(flat, std::numeric_limits<float>::quiet_NaN(), 2.0F), -1000.0F);
}

}  // namespace
}  // namespace camber::detail
