// Which frames a run can use, from what they share with the reference.

#include "camber/pipeline/stages/reach.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <vector>

namespace camber::stages {
namespace {

constexpr std::size_t kPoints = 100;

/// Frames 10, 20, ... of which nothing but their number is known.
LoadedFrames frames_of(std::size_t count, std::size_t reference) {
  LoadedFrames out;
  out.reference = reference;
  out.frames.resize(count);
  for (std::size_t k = 0; k < count; ++k) out.frames[k].id = static_cast<int>(10 * (k + 1));
  out.gray.resize(count);
  out.color.resize(count);
  out.masks.resize(count);
  return out;
}

/// @param shared  points of the reference that each image has, in per cent; its own is not used.
Correspondences matches_of(const std::vector<int>& shared, std::size_t reference) {
  Correspondences out;
  out.reference = static_cast<int>(reference);
  out.pixels.resize(kPoints);
  for (std::size_t k = 0; k < shared.size(); ++k) {
    if (k == reference) continue;
    MatchedImage match;
    match.frame = static_cast<int>(k);
    match.pixels.resize(kPoints);
    match.round_trip_px.assign(kPoints, std::numeric_limits<float>::infinity());
    std::fill_n(match.round_trip_px.begin(), shared[k], 0.1f);
    out.matches.push_back(match);
  }
  return out;
}

FrameRange shared_range(const std::vector<int>& shared, std::size_t reference) {
  return frames_that_share(frames_of(shared.size(), reference), matches_of(shared, reference));
}

TEST(FramesThatShare, EndAtTheFirstThatFallsShortOnEachSide) {
  // Frame 0 is beyond one that shares too little, whatever it seems to share itself.
  const FrameRange range = shared_range({30, 9, 22, 60, 0, 50, 15, 14}, 4);
  EXPECT_EQ(range.first, 2U);
  EXPECT_EQ(range.last, 6U);
}

TEST(FramesThatShare, AreAllWhereFewerThanThreeWouldBeLeft) {
  const FrameRange range = shared_range({2, 60, 0}, 2);
  EXPECT_EQ(range.size(), 3U);
}

TEST(FramesThatShare, AreAllWherePosesAreGiven) {
  LoadedFrames frames = frames_of(5, 2);
  for (SceneFrame& frame : frames.frames) frame.world_from_camera = SE3();
  const FrameRange range = frames_that_share(frames, matches_of({2, 60, 0, 60, 2}, 2));
  EXPECT_EQ(range.size(), 5U);
}

TEST(MatchesWithin, CountFramesFromTheFirstOfTheRange) {
  const Correspondences kept = matches_within({1, 3}, matches_of({1, 2, 0, 3, 4}, 2));
  EXPECT_EQ(kept.reference, 1);
  ASSERT_EQ(kept.matches.size(), 2U);
  EXPECT_EQ(kept.matches[0].frame, 0);
  EXPECT_EQ(kept.matches[1].frame, 2);
}

TEST(FramesWithin, HoldTheReferenceAndWhatIsKnownBetweenThem) {
  Scene scene;
  scene.height_above_road = 1.65;
  for (int id = 10; id <= 50; id += 10) {
    SceneFrame frame;
    frame.id = id;
    frame.time_s = 0.01 * id;
    frame.speed = 8.0;
    frame.speed_sigma = 0.1;
    scene.frames.push_back(frame);
  }
  LoadedFrames frames = frames_of(5, 3);
  const LoadedFrames kept = frames_within({2, 4}, scene, frames);
  ASSERT_EQ(kept.size(), 3U);
  EXPECT_EQ(kept.frames[kept.reference].id, 40);
  EXPECT_EQ(kept.gray.size(), 3U);
  EXPECT_EQ(kept.masks.size(), 3U);
  EXPECT_EQ(kept.known.camera_height, 1.65);
  ASSERT_EQ(kept.known.travelled.size(), 2U);
  EXPECT_NEAR(kept.known.travelled[0].value(), 0.8, 1e-9);
  EXPECT_THROW(frames_within({0, 2}, scene, frames), std::invalid_argument);
  EXPECT_THROW(frames_within({2, 5}, scene, frames), std::invalid_argument);
}

}  // namespace
}  // namespace camber::stages
