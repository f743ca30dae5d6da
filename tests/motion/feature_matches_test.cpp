// Sparse matches of made images that are far apart.

#include "camber/motion/feature_matches.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/motion/motion.h"
#include "motion/simulated_matches.h"

namespace camber {
namespace {

constexpr int kWidth = 480, kHeight = 240;

/// Random discs on grey, moved by some pixels: what leaves one side does not come back.
GrayImage discs(int right, int down) {
  constexpr int kDiscs = 260;
  GrayImage image{kWidth, kHeight, std::vector<std::uint8_t>(kWidth * kHeight, 128)};
  for (std::uint64_t d = 0; d < kDiscs; ++d) {
    CounterRandom random(7, d);
    const double x = random.uniform(0) * (2 * kWidth) - kWidth / 2 + right;
    const double y = random.uniform(1) * (2 * kHeight) - kHeight / 2 + down;
    const double radius = 4.0 + 14.0 * random.uniform(2);
    const auto grey = static_cast<std::uint8_t>(20 + 215 * random.uniform(3));
    for (int v = std::max(0, static_cast<int>(y - radius));
         v <= std::min(kHeight - 1, static_cast<int>(y + radius)); ++v) {
      for (int u = std::max(0, static_cast<int>(x - radius));
           u <= std::min(kWidth - 1, static_cast<int>(x + radius)); ++u) {
        if (std::hypot(u - x, v - y) <= radius) {
          image.pixels[static_cast<std::size_t>(v * kWidth + u)] = grey;
        }
      }
    }
  }
  return image;
}

TEST(FeatureMatches, FollowADisplacementOfAThirdOfTheImage) {
  const Eigen::Vector2f shift(150.0F, -40.0F);
  const Correspondences found = match_features({discs(0, 0), discs(150, -40)}, 0, {});
  ASSERT_EQ(found.matches.size(), 1u);
  EXPECT_EQ(found.rows, 1);
  ASSERT_EQ(found.columns, static_cast<int>(found.pixels.size()));
  ASSERT_EQ(found.texture.size(), found.pixels.size());
  ASSERT_GT(found.pixels.size(), 40u);
  std::size_t right = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    right += (found.matches[0].pixels[i] - found.pixels[i] - shift).norm() < 1.0F;
  }
  EXPECT_GT(static_cast<double>(right), 0.9 * static_cast<double>(found.pixels.size()));
}

TEST(FeatureMatches, AFeatureThatOneImageLacksIsMarked) {
  // The third image shows something else altogether.
  GrayImage other = discs(0, 0);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      other.pixels[static_cast<std::size_t>(v * kWidth + u)] = static_cast<std::uint8_t>(
          CounterRandom(3, static_cast<std::uint64_t>(v / 6 * 99 + u / 9)).uniform(0) * 255);
    }
  }
  const Correspondences found = match_features({discs(0, 0), discs(30, 0), other}, 0, {});
  ASSERT_EQ(found.matches.size(), 2u);
  std::size_t in_first = 0, in_second = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    in_first += std::isfinite(found.matches[0].round_trip_px[i]);
    in_second += std::isfinite(found.matches[1].round_trip_px[i]);
  }
  EXPECT_GT(in_first, 60u);
  EXPECT_LT(in_second, in_first / 10);
}

TEST(FeatureMatches, WithoutTextureThereAreNone) {
  const GrayImage empty{kWidth, kHeight, std::vector<std::uint8_t>(kWidth * kHeight, 99)};
  const Correspondences found = match_features({empty, discs(0, 0)}, 0, {});
  EXPECT_TRUE(found.pixels.empty());
  EXPECT_EQ(found.columns, 0);
}

TEST(FeatureMatches, AreTheSameForAnyNumberOfThreads) {
  FeatureMatchOptions one, three;
  one.num_threads = 1;
  three.num_threads = 3;
  const std::vector<GrayImage> images{discs(0, 0), discs(40, 5), discs(90, -8)};
  const Correspondences a = match_features(images, 1, one), b = match_features(images, 1, three);
  ASSERT_EQ(a.pixels, b.pixels);
  for (std::size_t k = 0; k < a.matches.size(); ++k) {
    EXPECT_EQ(a.matches[k].pixels, b.matches[k].pixels);
    EXPECT_EQ(a.matches[k].round_trip_px, b.matches[k].round_trip_px);
  }
}

TEST(FeatureMatches, MeaninglessInputIsRejected) {
  const GrayImage image = discs(0, 0);
  const GrayImage small{4, 4, std::vector<std::uint8_t>(16, 0)};
  EXPECT_THROW(match_features({image, small}, 0, {}), std::invalid_argument);
  EXPECT_THROW(match_features({image, image}, 2, {}), std::invalid_argument);
  FeatureMatchOptions none;
  none.max_features = 0;
  EXPECT_THROW(match_features({image, image}, 0, none), std::invalid_argument);
  FeatureMatchOptions ratio;
  ratio.ratio = 1.0;
  EXPECT_THROW(match_features({image, image}, 0, ratio), std::invalid_argument);
}

TEST(EpipolarAgreement, IsTheShareOfMatchesOnTheirLines) {
  const PinholeCamera camera = test::small_camera();
  const std::vector<SE3> poses = test::driving_motion();
  test::SimulatedMatchesOptions options;
  options.outliers = 0.3;
  const test::SimulatedMatches made = simulate_matches(camera, poses, 1, options);
  MotionEstimate motion;
  motion.frame_from_reference = poses;
  // Nearly all right matches, and of the wrong ones the few that hit their line by chance.
  const double at_truth = epipolar_agreement(camera, made.matches, made.all, motion, 0.5);
  EXPECT_GT(at_truth, 0.69);
  EXPECT_LT(at_truth, 0.78);
  motion.frame_from_reference[2] =
      SE3(rotation_from_vector({0.0, 0.02, 0.0}), Eigen::Vector3d::Zero()) * poses[2];
  EXPECT_LT(epipolar_agreement(camera, made.matches, made.all, motion, 0.5), at_truth - 0.2);
  // Of one image: the one whose pose is right, and the one whose pose is wrong.
  for (std::size_t m = 0; m < made.matches.matches.size(); ++m) {
    const double share = epipolar_agreement(camera, made.matches, made.all, motion, 0.5, m);
    if (made.matches.matches[m].frame == 2) {
      EXPECT_LT(share, 0.4);
    } else {
      EXPECT_NEAR(share, at_truth, 0.05);
    }
  }
  EXPECT_THROW(epipolar_agreement(camera, made.matches, made.all, motion, 0.5, 9),
               std::invalid_argument);
  EXPECT_EQ(epipolar_agreement(camera, made.matches, std::vector<std::uint8_t>(made.all.size(), 0),
                               motion, 0.5),
            0.0);
  EXPECT_THROW(epipolar_agreement(camera, made.matches, {}, motion, 0.5), std::invalid_argument);
}

}  // namespace
}  // namespace camber
