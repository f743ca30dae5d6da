// Roads that a film's coder repeats: a drawn street with broken lines, of whose asphalt a picture
// shows what the one before did unless it differs plainly.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/stages/match.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/passing_road.h"
#include "pipeline/made_drive.h"
#include "support/drawn_road.h"

namespace camber {
namespace {

constexpr double kStep = 1.2, kHeight = 1.65;  // m
constexpr int kImages = 5;

/// A level camera between houses, over asphalt with broken lines at both sides of the lane.
LoadedFrames street() {
  test::MadeDriveOptions options;
  options.pitch = 0.0;
  options.height = kHeight;
  options.stations.clear();
  for (int k = 0; k < kImages; ++k) options.stations.push_back(kStep * (k - kImages / 2));
  options.reference = kImages / 2;
  options.masks = false;
  test::MadeDrive drive = test::make_drive(options);
  test::DrawnRoad road;
  for (const double side : {-1.0, 1.0}) {
    for (int i = 0; i < 6; ++i) {
      road.boards.push_back({9.0 + 7.0 * i, std::min(5.0 * side, 14.0 * side),
                             std::max(5.0 * side, 14.0 * side), -4.0, kHeight, 0.0});
    }
  }
  road.light = [](double x, double z, int) {
    const double from = z - 9.0 * std::floor(z / 9.0);
    return std::abs(std::abs(x) - 1.75) < 0.08 && from < 3.0 ? 2.4 : 1.0;
  };
  LoadedFrames frames = drive.frames;
  const double baseline = drive.metres_per_baseline;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    frames.gray[k].pixels = test::draw_road(
        road, frames.camera, metric_pose(drive.motion, k, baseline).inverse(), static_cast<int>(k));
    for (std::size_t i = 0; i < frames.gray[k].pixels.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) {
        frames.color[k].data[3 * i + c] = frames.gray[k].pixels[i];
      }
    }
  }
  frames.known.camera_height_sigma = 0.02;
  return frames;
}

/// What is below the horizon stays as it was unless it changes by more than `least`.
void code(int least, LoadedFrames* frames) {
  const PinholeCamera& camera = frames->camera;
  const auto first =
      static_cast<std::size_t>(camera.cy + 4) * static_cast<std::size_t>(camera.width);
  for (std::size_t k = 1; k < frames->size(); ++k) {
    const std::vector<std::uint8_t>& before = frames->gray[k - 1].pixels;
    std::vector<std::uint8_t>& now = frames->gray[k].pixels;
    for (std::size_t i = first; i < now.size(); ++i) {
      if (std::abs(static_cast<int>(now[i]) - before[i]) < least) now[i] = before[i];
    }
  }
}

struct CodedStreet {
  LoadedFrames frames;
  Correspondences matches;
  MotionEstimate motion;
};

CodedStreet coded_street() {
  CodedStreet out;
  out.frames = street();
  code(40, &out.frames);
  out.matches = stages::match(out.frames, {});
  out.motion = stages::motion(out.frames, out.matches, {});
  return out;
}

WindowEstimate estimate(const LoadedFrames& frames) {
  Timings timings;
  const Progress silent;
  const StageRunner run(timings, silent);
  return estimate_window({}, frames, handed_down({}), run);
}

bool is_named(const std::vector<RunDocument::Warning>& warnings) {
  return std::any_of(warnings.begin(), warnings.end(),
                     [](const auto& w) { return w.code == "road_repeated"; });
}

double log_error(const WindowEstimate& window) {
  const double longest = kStep * static_cast<double>(kImages / 2);
  return std::log(window.judged.road.metres_per_baseline() / longest);
}

TEST(RepeatedRoad, ASeenOneIsThatOfTheMatches) {
  const WindowEstimate window = estimate(street());
  EXPECT_EQ(window.refined.ground.near_road, NearRoadSource::kMatches);
  EXPECT_FALSE(is_named(window.judged.warnings));
  EXPECT_LT(std::abs(log_error(window)), 2.0 * window.judged.scale.sigma);
}

TEST(RepeatedRoad, OneThatIsCodedHasItsMetres) {
  LoadedFrames frames = street();
  code(40, &frames);
  const WindowEstimate window = estimate(frames);
  EXPECT_LT(std::abs(log_error(window)), 2.0 * window.judged.scale.sigma);
  EXPECT_LT(window.judged.scale.sigma, 0.1);
}

TEST(RepeatedRoad, WhatPassesIsAPlaneThatGivesTheMetres) {
  auto [frames, matches, motion] = coded_street();
  const auto sweep = stages::sweep_road(frames, motion, 1);
  ASSERT_TRUE(sweep);
  const auto found = stages::another_ground(frames, matches, motion, nullptr, sweep, false,
                                            stages::GroundOptions());
  ASSERT_TRUE(found);
  const Ground& ground = *found;
  EXPECT_EQ(ground.near_road, NearRoadSource::kPassing);
  EXPECT_FALSE(stages::shows_another(sweep->log_baseline, ground.ego));
  const double height = kHeight / (kStep * static_cast<double>(kImages / 2));  // baselines
  EXPECT_LT(std::abs(std::log(ground.ego.height / height)), 2.0 * ground.ego.relative_sigma);
  for (const double v : {150.0, 200.0, 230.0}) {  // level, before the camera
    const double expected = (v - frames.camera.cy) / frames.camera.fy / height;
    EXPECT_NEAR(ground.field->inverse_depth({frames.camera.cx, v}) / expected, 1.0, 0.16) << v;
  }
  const JudgedRoad judged =
      test::judged_road(frames, matches, PhotometricGround{ground, motion, nullptr, {}, {}, {}});
  EXPECT_TRUE(is_named(judged.warnings));
  EXPECT_LT(std::abs(std::log(judged.road.metres_per_baseline() /
                              (kStep * static_cast<double>(kImages / 2)))),
            2.0 * judged.scale.sigma);
  // A ground three times as far below is another.
  EgoPlane far = ground.ego;
  far.height *= 3.0;
  EXPECT_TRUE(stages::shows_another(sweep->log_baseline, far));
}

/// So many times the true way between the frames by the speed.
void give_speed(double factor, LoadedFrames* frames) {
  frames->known.travelled.assign(frames->size() - 1, factor * kStep);
  frames->known.travelled_sigma = {};
  frames->known.travelled_sigma.common = 0.02 * factor * kStep * (kImages - 1);
}

TEST(RepeatedRoad, TwoOfMatchesSweepAndSpeedDecide) {
  auto [frames, matches, motion] = coded_street();
  const auto sweep = stages::sweep_road(frames, motion, 1);
  ASSERT_TRUE(sweep);
  const auto another = [&, &frames = frames, &matches = matches, &motion = motion](
                           double factor, const Ground* found,
                           const std::optional<RoadSweepResult>& by) {
    give_speed(factor, &frames);
    return stages::another_ground(frames, matches, motion, found, by, true,
                                  stages::GroundOptions());
  };
  const auto passing = another(1.0, nullptr, sweep);
  ASSERT_TRUE(passing);
  EXPECT_EQ(passing->near_road, NearRoadSource::kPassing);
  const auto by_speed = another(1.6, nullptr, sweep);
  ASSERT_TRUE(by_speed);
  EXPECT_EQ(by_speed->near_road, NearRoadSource::kSpeed);
  // Whatever a wrong sweep shows: matches that the speed agrees with stay.
  RoadSweepResult wrong = *sweep;
  wrong.log_baseline += 0.5;
  EXPECT_FALSE(another(1.0, &*passing, wrong));
  Ground far = *passing;
  far.ego.height *= 3.0;
  const auto alone = another(1.0, &far, std::nullopt);
  ASSERT_TRUE(alone);
  EXPECT_EQ(alone->near_road, NearRoadSource::kSpeed);
  frames.known.camera_height.reset();
  EXPECT_FALSE(stages::another_ground(frames, matches, motion, &far, std::nullopt, true,
                                      stages::GroundOptions()));
}

TEST(RepeatedRoad, ByTheSpeedAloneItHasItsMetresAndSaysSo) {
  auto [frames, matches, motion] = coded_street();
  give_speed(1.0, &frames);
  const auto ground = stages::another_ground(frames, matches, motion, nullptr, std::nullopt, true,
                                             stages::GroundOptions());
  ASSERT_TRUE(ground);
  const JudgedRoad judged =
      test::judged_road(frames, matches, PhotometricGround{*ground, motion, nullptr, {}, {}, {}});
  EXPECT_TRUE(is_named(judged.warnings));
  EXPECT_LT(std::abs(std::log(judged.road.metres_per_baseline() /
                              (kStep * static_cast<double>(kImages / 2)))),
            2.0 * judged.scale.sigma);
}

}  // namespace
}  // namespace camber
