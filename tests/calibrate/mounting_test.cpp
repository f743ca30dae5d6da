#include "camber/calibrate/mounting.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calibrate/simulated_drive.h"

namespace camber {
namespace {

std::vector<WindowBundle> windows_of(const test::SimulatedDriveOptions& options) {
  std::vector<WindowBundle> out;
  for (CalibrationWindow& window : test::true_windows(test::simulate_drive(options), 8)) {
    out.emplace_back(std::move(window));
  }
  return out;
}

test::SimulatedDriveOptions mounted_camera() {
  test::SimulatedDriveOptions out;
  out.lens = {640, 360, 420.0, 319.5, 179.5, 0.0, 0.0};
  out.pitch = -0.035;
  out.yaw = 0.02;
  out.roll = 0.03;
  out.key_frames = 57;
  return out;
}

TEST(Mounting, OfAStraightDrive) {
  const auto options = mounted_camera();
  DriveLens::Matrix exact = DriveLens::Matrix::Zero();
  const Mounting mounting = estimate_mounting(windows_of(options), options.lens, exact);
  ASSERT_TRUE(mounting.pitch && mounting.yaw && mounting.roll);
  // The shaking of 0.004 rad over 56 frames.
  EXPECT_NEAR(mounting.pitch->value, options.pitch, 0.002);
  // In the rolled camera: pitch times roll, 0.001, is a part of it.
  EXPECT_NEAR(mounting.yaw->value, options.yaw, 0.002);
  EXPECT_NEAR(mounting.roll->value, options.roll, 0.006);
  EXPECT_LT(mounting.pitch->sigma, 0.003);
  // An error of the principal point is one of the angles.
  exact(2, 2) = 8.0 * 8.0;
  EXPECT_GT(estimate_mounting(windows_of(options), options.lens, exact).pitch->sigma, 8.0 / 420.0);
}

TEST(Mounting, HeightIsSeenInStepsOfTheWindow) {
  const auto options = mounted_camera();
  int roads = 0;
  const test::SimulatedDrive drive = test::simulate_drive(options);
  for (const CalibrationWindow& window : test::true_windows(drive, 8)) {
    const auto road = road_of_window(window);
    if (!road) continue;
    ++roads;
    // Units of the longest baseline, four steps.
    EXPECT_NEAR(road->height * 4.0 * options.step, options.height, 0.05);
    EXPECT_GT(road->depth, 2.0 * road->height);
    EXPECT_LT(road->depth, 30.0 * road->height);
  }
  EXPECT_GE(roads, 6);
}

TEST(Mounting, HeightIsThatOfTheSpeeds) {
  const auto options = mounted_camera();
  const std::vector<WindowBundle> windows = windows_of(options);
  Scene scene;
  std::vector<int> ids;
  for (int k = 0; k < options.key_frames; ++k) {
    SceneFrame frame;  // every second one is a key frame
    for (const int id : {2 * k, 2 * k + 1}) {
      frame.id = id;
      frame.time_s = 0.1 * id;
      frame.speed = options.step / 0.2;
      frame.speed_sigma = 0.03 * *frame.speed;
      scene.frames.push_back(frame);
    }
    ids.push_back(2 * k);
  }
  const auto metres = metres_by_speed(scene, ids);
  ASSERT_TRUE(metres);
  ASSERT_EQ(metres->steps.size(), ids.size() - 1);
  EXPECT_NEAR(metres->steps[3], options.step, 1e-9);
  EXPECT_LE(metres->sigma, 0.0301);
  EXPECT_GT(metres->sigma, 0.003);
  const auto height = estimate_height(windows, *metres, 0.02);
  ASSERT_TRUE(height);
  EXPECT_NEAR(height->value, options.height, 0.03);  // 0.05 of one window
  EXPECT_GT(height->sigma, options.height * std::hypot(metres->sigma, 0.02) - 1e-3);
  EXPECT_LT(height->sigma, 0.08);

  // A step without a speed leaves its window out; without any there are no metres.
  for (SceneFrame& frame : scene.frames) {
    if (frame.id < 2 * 14) frame.speed.reset();
  }
  const auto part = metres_by_speed(scene, ids);
  ASSERT_TRUE(part);
  EXPECT_TRUE(std::isnan(part->steps[0]));
  const auto of_part = estimate_height(windows, *part, 0.02);
  ASSERT_TRUE(of_part);
  EXPECT_EQ(of_part->windows, height->windows - 2);
  for (SceneFrame& frame : scene.frames) frame.speed.reset();
  EXPECT_FALSE(metres_by_speed(scene, ids));
}

TEST(Mounting, HeightIsThatOfThePositions) {
  const auto options = mounted_camera();
  const std::vector<WindowBundle> windows = windows_of(options);
  Scene scene;
  std::vector<int> ids;
  for (int k = 0; k < options.key_frames; ++k) {
    SceneFrame frame;
    frame.id = 3 * k;
    frame.time_s = 0.1 * k;
    MapPosition at;  // a receiver that is 2 m off and drifts by 0.2 m within the drive
    const double drift = 2.0 + 0.1 * std::sin(1.1 * k * 0.1);
    at.position = {500000.0 + options.step * k + drift, 5400000.0 - drift, 300.0};
    frame.map_position = at;
    scene.frames.push_back(frame);
    ids.push_back(frame.id);
  }
  EXPECT_FALSE(metres_by_speed(scene, ids));
  const auto metres = metres_by_positions(scene, ids);
  ASSERT_TRUE(metres);
  EXPECT_TRUE(metres->by_positions);
  for (std::size_t k = 10; k < 40; ++k) EXPECT_NEAR(metres->steps[k], options.step, 0.03) << k;
  EXPECT_GT(metres->sigma, 0.01);  // half a metre a second, of 9
  EXPECT_LT(metres->sigma, 0.08);
  const auto height = estimate_height(windows, *metres, 0.02);
  ASSERT_TRUE(height);
  EXPECT_NEAR(height->value, options.height, 0.05);
  EXPECT_LT(std::abs(height->value - options.height), 2.0 * height->sigma);

  // Fixes of centimetres say more.
  for (SceneFrame& frame : scene.frames) frame.map_position->sigma = 0.02;
  EXPECT_LT(metres_by_positions(scene, ids)->sigma, metres->sigma);
  // A vehicle that stands is lost in the noise of its receiver.
  for (SceneFrame& frame : scene.frames) {
    frame.map_position->sigma = 2.5;
    frame.map_position->position.x() = 500000.0 + 0.01 * frame.id;
  }
  EXPECT_FALSE(metres_by_positions(scene, ids));
  for (SceneFrame& frame : scene.frames) frame.map_position.reset();
  EXPECT_FALSE(metres_by_positions(scene, ids));
}

TEST(Mounting, TravelStepsKnowTheTurn) {
  auto options = mounted_camera();
  options.turn = 0.03;
  options.shake = 0.0;
  options.roll = options.pitch = 0.0;
  const auto windows = test::true_windows(test::simulate_drive(options), 8);
  const std::vector<TravelStep> steps = travel_steps(windows[0]);
  ASSERT_EQ(steps.size(), 7U);
  for (const TravelStep& step : steps) {
    EXPECT_NEAR(step.turn, 0.03, 1e-9);
    EXPECT_NEAR(step.direction.norm(), 1.0, 1e-12);
    EXPECT_NEAR(-std::atan2(step.direction.x(), step.direction.z()), options.yaw, 1e-6);
  }
}

TEST(Mounting, NothingOfNoWindows) {
  const Mounting mounting =
      estimate_mounting({}, mounted_camera().lens, DriveLens::Matrix::Identity());
  EXPECT_FALSE(mounting.pitch || mounting.yaw || mounting.roll);
}

}  // namespace
}  // namespace camber
