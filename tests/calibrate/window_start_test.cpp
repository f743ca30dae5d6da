#include "camber/calibrate/window_start.h"

#include <gtest/gtest.h>

#include "calibrate/simulated_drive.h"

namespace camber {
namespace {

TEST(WindowStart, FindsMotionAndPoints) {
  test::SimulatedDriveOptions options;
  options.lens = {640, 360, 420.0, 322.0, 176.0, -0.15, 0.0};
  options.key_frames = 8;
  options.turn = 0.02;
  options.points = 1500;
  const test::SimulatedDrive drive = test::simulate_drive(options);
  const auto window = start_window(options.lens, drive.tracks, 0, 8, {});
  ASSERT_TRUE(window);
  EXPECT_EQ(window->reference, 4U);
  EXPECT_GT(window->points.size(), 150U);
  for (std::size_t k = 0; k < 8; ++k) {
    const SE3 truth = drive.camera_from_world[k] * drive.camera_from_world[4].inverse();
    const Eigen::Quaterniond off =
        window->frame_from_reference[k].rotation() * truth.rotation().inverse();
    EXPECT_LT(rotation_to_vector(off).norm(), 0.004) << k;
  }
  double inside = 0.0, all = 0.0;
  for (const Eigen::Vector2d& e : WindowBundle::errors(*window, options.lens)) {
    inside += e.norm() < 1.0 ? 1.0 : 0.0;
    all += 1.0;
  }
  EXPECT_GT(inside, 0.95 * all);
}

TEST(WindowStart, NothingWithoutEnoughTracks) {
  const DriveLens lens{640, 360, 420.0, 319.5, 179.5, 0.0, 0.0};
  EXPECT_FALSE(start_window(lens, {}, 0, 8, {}));
}

TEST(WindowStart, NothingOfACameraThatStands) {
  test::SimulatedDriveOptions options;
  options.lens = {640, 360, 420.0, 319.5, 179.5, 0.0, 0.0};
  options.key_frames = 6;
  options.step = 0.0;
  options.shake = 0.0;
  options.pixel_sigma = 0.05;
  EXPECT_FALSE(start_window(options.lens, test::simulate_drive(options).tracks, 0, 6, {}));
}

}  // namespace
}  // namespace camber
