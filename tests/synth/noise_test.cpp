#include "camber/synth/detail/noise.h"

#include <gtest/gtest.h>

namespace camber {
namespace {

TEST(Noise, HasZeroMeanAndTheStatedSpread) {
  double sum = 0.0, squares = 0.0, largest = 0.0;
  const int n = 200;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const float x =
          gradient_noise({0.37f * static_cast<float>(i), 0.41f * static_cast<float>(j)}, 5);
      sum += x;
      squares += x * x;
      largest = std::max(largest, static_cast<double>(std::fabs(x)));
    }
  }
  const double mean = sum / (n * n), spread = std::sqrt(squares / (n * n));
  EXPECT_NEAR(mean, 0.0, 0.02);
  EXPECT_NEAR(spread, 0.27, 0.03);
  EXPECT_LT(largest, 1.6);
}

TEST(Noise, OctavesThatAPixelCannotHoldAreGone) {
  EXPECT_EQ(octave({0.31f, 0.72f}, 0.1f, 0.07f, 3), 0.0f);  // 1.4 px a wave
  EXPECT_NE(octave({0.31f, 0.72f}, 0.1f, 0.03f, 3), 0.0f);  // 3.3 px
  EXPECT_EQ(octave_weight(1.0f, 0.2f), 1.0f);
}

TEST(Noise, CoversAreExactShares) {
  EXPECT_FLOAT_EQ(strip_cover(0.0f, 0.06f, 0.01f), 1.0f);
  EXPECT_FLOAT_EQ(strip_cover(0.06f, 0.06f, 0.01f), 0.5f);
  EXPECT_FLOAT_EQ(strip_cover(0.0f, 0.06f, 0.48f), 0.25f);  // a line narrower than the pixel
  EXPECT_FLOAT_EQ(strip_cover(0.2f, 0.06f, 0.01f), 0.0f);
  // The covers of a row of pixels add up to the line's width.
  float sum = 0.0f;
  for (int i = -20; i <= 20; ++i)
    sum += strip_cover(0.05f * static_cast<float>(i) + 0.013f, 0.06f, 0.05f);
  EXPECT_NEAR(sum * 0.05f, 0.12f, 1e-6f);
  EXPECT_FLOAT_EQ(below_edge(0.0f, 1.0f), 0.5f);
  EXPECT_FLOAT_EQ(below_edge(-0.25f, 1.0f), 0.75f);
}

}  // namespace
}  // namespace camber
