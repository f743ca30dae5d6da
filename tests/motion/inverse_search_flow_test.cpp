// Dense inverse search on waves that are moved by a known amount.

#include "camber/motion/detail/inverse_search_flow.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/core/random.h"

namespace camber::detail {
namespace {

constexpr int kWidth = 240, kHeight = 160;
constexpr int kMargin = 16;  // px; what the flow says of the rim is left out

/// Waves of 8 to 60 px in length, seen after the image has grown about its middle and moved.
cv::Mat waves(double growth, double right, double down) {
  const CounterRandom random(7);
  cv::Mat out(kHeight, kWidth, CV_32FC1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double u = (x - 0.5 * kWidth - right) / growth, v = (y - 0.5 * kHeight - down) / growth;
      double sum = 128.0;
      for (std::uint64_t k = 0; k < 40; ++k) {
        const double frequency = 2.0 * M_PI / (8.0 * std::pow(7.5, random.uniform(3 * k)));
        const double angle = random.uniform(3 * k + 1, 0.0, 2.0 * M_PI);
        sum += 10.0 * std::cos(frequency * (std::cos(angle) * u + std::sin(angle) * v) +
                               random.uniform(3 * k + 2, 0.0, 2.0 * M_PI));
      }
      out.at<float>(y, x) = static_cast<float>(sum);
    }
  }
  return out;
}

/// Distances from the true flow of waves(), ascending.
std::vector<double> errors(const DenseFlow& flow, double growth, double right, double down) {
  std::vector<double> out;
  for (int y = kMargin; y < kHeight - kMargin; y += 3) {
    for (int x = kMargin; x < kWidth - kMargin; x += 3) {
      const double u = (growth - 1.0) * (x - 0.5 * kWidth) + right;
      const double v = (growth - 1.0) * (y - 0.5 * kHeight) + down;
      const cv::Point2f found = flow.at(static_cast<float>(x), static_cast<float>(y));
      out.push_back(std::hypot(found.x - u, found.y - v));
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

double quantile(const std::vector<double>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

TEST(InverseSearchFlow, FollowsGrowthAndMotionAtEveryResolution) {
  const cv::Mat a = waves(1.0, 0.0, 0.0), b = waves(1.05, 5.3, -2.6);
  for (const int scale : {0, 1, 2}) {
    const DenseFlow flow =
        inverse_search_flow(FlowPyramid(a, scale), FlowPyramid(b, scale), InverseSearchOptions());
    const std::vector<double> off = errors(flow, 1.05, 5.3, -2.6);
    // Noise-free: what is left is growth within a patch, interpolation and resolution.
    EXPECT_LT(quantile(off, 0.5), 0.06 * (1 << scale)) << scale;
    EXPECT_LT(quantile(off, 0.95), 0.25 * (1 << scale)) << scale;
  }
}

TEST(InverseSearchFlow, ABrighterImageMovesNothing) {
  const cv::Mat a = waves(1.0, 0.0, 0.0);
  const cv::Mat b = waves(1.0, 1.5, 0.5) + 20.0;
  const DenseFlow flow =
      inverse_search_flow(FlowPyramid(a, 0), FlowPyramid(b, 0), InverseSearchOptions());
  EXPECT_LT(quantile(errors(flow, 1.0, 1.5, 0.5), 0.9), 0.1);
}

TEST(InverseSearchFlow, IsTheSameInsideAWantedPart) {
  const cv::Mat a = waves(1.0, 0.0, 0.0), b = waves(1.0, 1.3, -0.7);
  const FlowPyramid from(a, 0), to(b, 0);
  std::vector<std::uint8_t> wanted(static_cast<std::size_t>(kWidth * kHeight), 0);
  for (int y = 80; y < kHeight; ++y) {
    std::fill_n(wanted.begin() + y * kWidth + 60, 120, std::uint8_t{1});
  }
  const DenseFlow whole = inverse_search_flow(from, to, InverseSearchOptions());
  const DenseFlow part = inverse_search_flow(from, to, InverseSearchOptions(), {}, wanted.data());
  for (int y = 96; y < kHeight - kMargin; y += 4) {
    for (int x = 76; x < 164; x += 4) {
      const auto u = static_cast<float>(x), v = static_cast<float>(y);
      // Patches start from other neighbours and end in the same places.
      EXPECT_LT(cv::norm(whole.at(u, v) - part.at(u, v)), 0.02) << x << " " << y;
    }
  }
}

TEST(InverseSearchFlow, AFirstGuessReachesWhatIsTooFarAway) {
  const double far = 90.0;  // px, of 240
  const cv::Mat a = waves(1.0, 0.0, 0.0), b = waves(1.0, far, 0.0);
  const FlowPyramid from(a, 1), to(b, 1);
  const DenseFlow guess(cv::Mat(kHeight / 2, kWidth / 2, CV_32FC2, cv::Scalar(44.0, 0.0)), 1);
  const DenseFlow flow = inverse_search_flow(from, to, InverseSearchOptions(), guess);
  const cv::Point2f found = flow.at(60.0F, 80.0F);
  EXPECT_NEAR(found.x, far, 0.3);
  EXPECT_NEAR(found.y, 0.0, 0.3);
}

TEST(InverseSearchFlow, OneAfterAnother) {
  const DenseFlow first(cv::Mat(40, 60, CV_32FC2, cv::Scalar(2.0, -1.0)), 1);
  const DenseFlow second(cv::Mat(40, 60, CV_32FC2, cv::Scalar(0.5, 3.0)), 1);
  const cv::Point2f both = first.followed_by(second).at(50.0F, 30.0F);
  EXPECT_NEAR(both.x, 2.0 * 2.5, 1e-5);
  EXPECT_NEAR(both.y, 2.0 * 2.0, 1e-5);
}

TEST(InverseSearchFlow, SmallAndFlatImagesDoNotMove) {
  for (const cv::Size& size : {cv::Size(5, 4), cv::Size(9, 40), cv::Size(64, 48)}) {
    const cv::Mat flat(size, CV_8UC1, cv::Scalar(90));
    const FlowPyramid pyramid(flat, 2);
    const cv::Point2f found =
        inverse_search_flow(pyramid, pyramid, InverseSearchOptions()).at(2.0F, 2.0F);
    EXPECT_EQ(found, cv::Point2f()) << size;
  }
}

}  // namespace
}  // namespace camber::detail
