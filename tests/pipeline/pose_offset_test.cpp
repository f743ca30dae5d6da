// A clock that is off, by the turns of poses and images.

#include "camber/pipeline/pose_offset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "camber/core/random.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

/// Turns of a drive of bends, rad a step, at i plus a shift; with noise of its own.
std::vector<double> turns(double shift, double noise, int seed, double bends = 1.0) {
  CounterRandom random(static_cast<std::uint64_t>(seed));
  std::vector<double> out;
  for (int i = 0; i < 120; ++i) {
    const double t = 0.1 * (i - shift);
    const double rate = bends * 0.012 * (std::sin(0.9 * t) + 0.6 * std::sin(2.3 * t + 1.0));
    out.push_back(
        std::abs(rate + noise * (2.0 * random.uniform(static_cast<std::uint64_t>(i)) - 1.0)));
  }
  return out;
}

TEST(PoseOffset, AShiftIsFoundToPartsOfAFrame) {
  for (const double shift : {-17.0, -4.5, 6.0, 23.25}) {
    const auto found = turn_offset(turns(0.0, 1e-3, 1), turns(shift, 2e-4, 2), 0.1);
    ASSERT_TRUE(found.has_value()) << shift;
    EXPECT_NEAR(found->frames, shift, 0.6) << shift;
    EXPECT_NEAR(found->seconds, 0.1 * shift, 0.06);
    EXPECT_GT(found->correlation, 0.8);
    EXPECT_LT(found->without, 0.7);
  }
  EXPECT_THAT(describe({-0.45, -4.5, 0.97, 0.1}), HasSubstr("0.45 s (4.5 frames) are added to"));
  EXPECT_THAT(describe({0.6, 6.0, 0.97, 0.1}), HasSubstr("0.60 s (6.0 frames) are taken off"));
}

TEST(PoseOffset, WhatShowsNoShiftHasNone) {
  const std::vector<double> images = turns(0.0, 1e-3, 1);
  EXPECT_FALSE(turn_offset(images, turns(0.0, 2e-4, 2), 0.1)) << "the clocks agree";
  EXPECT_FALSE(turn_offset(turns(0.0, 1e-3, 1, 0.0), turns(0.0, 1e-3, 2, 0.0), 0.1)) << "straight";
  EXPECT_FALSE(turn_offset(images, std::vector<double>(120, 0.02), 0.1)) << "a steady bend";
  std::vector<double> twice = turns(6.0, 2e-4, 2);
  for (double& turn : twice) turn *= 2.0;
  EXPECT_FALSE(turn_offset(images, twice, 0.1)) << "turns of another drive: twice as large";
  const std::vector<double> few(images.begin(), images.begin() + 20);
  EXPECT_FALSE(turn_offset(few, few, 0.1));
  // A course that repeats itself shows several shifts.
  std::vector<double> wave, shifted;
  for (int i = 0; i < 120; ++i) {
    wave.push_back(0.01 + 0.01 * std::sin(0.6 * i));
    shifted.push_back(0.01 + 0.01 * std::sin(0.6 * (i - 4)));
  }
  EXPECT_FALSE(turn_offset(wave, shifted, 0.1));
}

/// A turn of a real drive, with poses of eight rows later: image i has the pose of i + 8.
TEST(PoseOffset, RowsOfARealDriveThatAreOffAreCounted) {
  CAMBER_REQUIRE_DATA("drives/kitti-odometry-03/poses.txt");
  const std::filesystem::path folder = test::data_dir() / "drives/kitti-odometry-03";
  std::vector<SE3> poses;
  std::ifstream rows(folder / "poses.txt");
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  while (rows >> pose(0, 0)) {
    for (int i = 1; i < 12; ++i) rows >> pose(i / 4, i % 4);
    poses.push_back(SE3::from_matrix(pose));
  }
  ASSERT_GT(poses.size(), 160u);
  const auto scene_of = [&](int later) {
    Scene scene;
    scene.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
    scene.frame_rate = 10.0;
    for (int id = 50; id < 140; ++id) {
      SceneFrame frame;
      frame.id = id;
      frame.image = folder / "image_0" /
                    (std::string(id < 100 ? "0000" : "000") + std::to_string(id) + ".jpg");
      frame.world_from_camera = poses[static_cast<std::size_t>(id + later)];
      scene.frames.push_back(frame);
    }
    return scene;
  };
  const auto found = find_pose_offset(scene_of(8), 95, {});
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->frames, -8.0, 0.3);
  EXPECT_NEAR(found->seconds, -0.8, 0.03);
  EXPECT_GT(found->correlation, 0.95);
  EXPECT_FALSE(find_pose_offset(scene_of(0), 95, {}));
}

}  // namespace
}  // namespace camber
