#include "camber/calibrate/feature_tracks.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/random.h"

namespace camber {
namespace {

/// A smooth random texture, moved by (dx, dy) px.
GrayImage texture(int width, int height, double dx, double dy) {
  const CounterRandom random(4);
  struct Wave {
    double kx, ky, phase, size;
  };
  std::vector<Wave> waves;
  for (std::uint64_t i = 0; i < 60; ++i) {
    waves.push_back({random.uniform(4 * i, -0.9, 0.9), random.uniform(4 * i + 1, -0.9, 0.9),
                     random.uniform(4 * i + 2, 0.0, 6.28), random.uniform(4 * i + 3, 4.0, 14.0)});
  }
  GrayImage out{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double value = 128.0;
      for (const Wave& w : waves) {
        value += w.size * std::sin(w.kx * (x - dx) + w.ky * (y - dy) + w.phase);
      }
      out.pixels.push_back(static_cast<std::uint8_t>(std::min(255.0, std::max(0.0, value))));
    }
  }
  return out;
}

FeatureTrackOptions few_tiles() {
  FeatureTrackOptions out;
  out.tiles_across = 5;
  out.tiles_down = 3;
  out.features_a_tile = 8;
  out.key_motion = 0.015;
  return out;
}

TEST(FeatureTracker, FollowsAMovingPicture) {
  FeatureTracker tracker(few_tiles());
  EXPECT_TRUE(tracker.add(texture(320, 180, 0.0, 0.0)));
  // Steps of 2.6 px: a key frame (4.8 px) is every second one.
  EXPECT_FALSE(tracker.add(texture(320, 180, 2.6, 0.4)));
  EXPECT_TRUE(tracker.add(texture(320, 180, 5.2, 0.8)));
  EXPECT_FALSE(tracker.add(texture(320, 180, 7.8, 1.2)));
  EXPECT_TRUE(tracker.add(texture(320, 180, 10.4, 1.6)));
  EXPECT_EQ(tracker.key_frames(), 3U);
  const std::vector<FeatureTrack> tracks = tracker.take();
  std::size_t whole = 0, steps = 0, right = 0;
  for (const FeatureTrack& track : tracks) {
    for (std::size_t k = 1; k < track.pixels.size(); ++k) {
      const Eigen::Vector2d step = track.pixels[k] - track.pixels[k - 1];
      ++steps;
      right += (step - Eigen::Vector2d(5.2, 0.8)).norm() < 0.1 ? 1 : 0;
      // Where the picture is white or black there is less to see.
      EXPECT_LT((step - Eigen::Vector2d(5.2, 0.8)).norm(), 0.6);
    }
    whole += track.pixels.size() == 3 ? 1 : 0;
  }
  EXPECT_GT(whole, 70U);
  EXPECT_GT(right, steps * 95 / 100);
}

TEST(FeatureTracker, PixelsAreThoseOfTheGivenImage) {
  FeatureTrackOptions options = few_tiles();
  options.largest_width = 160;
  FeatureTracker tracker(options);
  tracker.add(texture(320, 180, 0.0, 0.0));
  ASSERT_TRUE(tracker.add(texture(320, 180, 6.0, -2.0)));
  double sum = 0.0;
  const std::vector<FeatureTrack> tracks = tracker.take();
  ASSERT_GT(tracks.size(), 20U);
  for (const FeatureTrack& track : tracks) {
    sum += (track.pixels[1] - track.pixels[0] - Eigen::Vector2d(6.0, -2.0)).norm();
  }
  EXPECT_LT(sum / static_cast<double>(tracks.size()), 0.3);
}

TEST(FeatureTracker, AStandingCameraHasOneKeyFrame) {
  FeatureTracker tracker(few_tiles());
  for (int k = 0; k < 5; ++k) tracker.add(texture(320, 180, 0.0, 0.0));
  EXPECT_EQ(tracker.key_frames(), 1U);
  EXPECT_LT(tracker.largest_motion(), 0.05);
  EXPECT_TRUE(tracker.take().empty());
}

TEST(FeatureTracker, Refuses) {
  FeatureTracker tracker({});
  EXPECT_THROW(tracker.add(GrayImage{}), std::invalid_argument);
  tracker.add(texture(128, 64, 0.0, 0.0));
  EXPECT_THROW(tracker.add(texture(128, 66, 0.0, 0.0)), std::invalid_argument);
  FeatureTrackOptions bad;
  bad.key_motion = 0.0;
  EXPECT_THROW(FeatureTracker{bad}, std::invalid_argument);
}

}  // namespace
}  // namespace camber
