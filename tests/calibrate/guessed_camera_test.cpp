#include "camber/calibrate/guessed_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "calibrate/simulated_drive.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

Scene guessed_scene(double focal, double focal_sigma, int frames) {
  Scene out;
  out.camera = {640, 360, focal, focal, 319.5, 179.5};
  out.camera_sigma.focal = focal_sigma;
  for (int k = 0; k < frames; ++k) {
    SceneFrame frame;
    frame.id = k;
    out.frames.push_back(frame);
  }
  return out;
}

TEST(GuessedCamera, IsOneOfWhichOnlyTheFocalLengthsDoubtIsStated) {
  EXPECT_TRUE(camera_is_guessed(guessed_scene(450, 0.4, 3)));
  EXPECT_TRUE(camera_is_guessed(guessed_scene(450, 0.09, 3)));
  EXPECT_FALSE(camera_is_guessed(guessed_scene(450, 0.0, 3)));   // manifests without doubt
  EXPECT_FALSE(camera_is_guessed(guessed_scene(450, 0.01, 3)));  // typed in pixels
  // What another calibration says, also a poor one: this drive may be in it already.
  for (double CameraSigma::*other : {&CameraSigma::principal, &CameraSigma::distortion}) {
    Scene calibrated = guessed_scene(450, 0.2, 3);
    calibrated.camera_sigma.*other = 0.05;
    EXPECT_FALSE(camera_is_guessed(calibrated));
  }
  Scene with_lens = guessed_scene(450, 0.2, 3);
  with_lens.distortion = DriveLens{640, 360, 450.0, 319.5, 179.5, -0.2, 0.0}.distortion();
  EXPECT_FALSE(camera_is_guessed(with_lens));
}

TEST(GuessedCamera, GuessIsThePriorWithItsDoubt) {
  const LensPrior prior = lens_prior_of(guessed_scene(450, 0.25, 3));
  const LensPrior cars = lens_prior_of_cars(640, 360);
  EXPECT_EQ(prior.mean.f, 450.0);
  EXPECT_EQ(prior.sigma(0), 0.25);
  EXPECT_EQ(prior.sigma.tail<6>(), cars.sigma.tail<6>());
}

TEST(GuessedCamera, StaysWhereNothingShowsIt) {
  const Scene few = guessed_scene(450, 0.4, 5);
  const CameraByDrive camera = calibrate_guessed(few, {0, 1, 2, 3, 4}, {});
  EXPECT_FALSE(camera.scene);
  EXPECT_FALSE(camera.calibration);
  EXPECT_THAT(camera.text, HasSubstr("5 frames are too few"));
  EXPECT_EQ(to_json(camera).at("used"), false);

  // No image can be read: what comes after says which.
  const Scene blind = guessed_scene(450, 0.4, 9);
  const CameraByDrive unseen = calibrate_guessed(blind, select_frames(blind, ""), {});
  EXPECT_FALSE(unseen.scene);
  EXPECT_THAT(unseen.text, HasSubstr("stays as it was guessed"));
}

TrackedDrive turning_drive() {
  test::SimulatedDriveOptions options;
  options.lens = {640, 360, 420.0, 326.0, 183.0, -0.12, 0.0};
  options.key_frames = 29;
  options.turn = 0.02;
  options.points = 400;
  options.seed = 11;
  TrackedDrive out;
  out.width = 640;
  out.height = 360;
  out.tracks = test::simulate_drive(options).tracks;
  for (int k = 0; k < options.key_frames; ++k) out.key_ids.push_back(k);
  return out;
}

DriveCalibration with_prior(double focal, double sigma) {
  CalibrateOptions options;
  options.num_threads = 2;
  options.prior = lens_prior_of(guessed_scene(focal, sigma, 3));
  return calibrate_tracks(turning_drive(), options);
}

TEST(GuessedCamera, IsJoinedWithTheDriveOnce) {
  CalibrateOptions alone;
  alone.num_threads = 2;
  const DriveCalibration drive = calibrate_tracks(turning_drive(), alone);
  const double known = drive.lens.sigma(0);
  ASSERT_LT(known, 0.05);
  EXPECT_EQ(drive.focal_surprise, 0.0);
  // A vague guess changes nothing; a good one counts by its sigma.
  const DriveCalibration vague = with_prior(500, 0.4);
  EXPECT_NEAR(std::log(vague.lens.lens.f / drive.lens.lens.f), 0.0, 0.3 * known);
  EXPECT_NEAR(vague.lens.sigma(0), known, 0.1 * known);
  const DriveCalibration good = with_prior(420, 0.004);
  EXPECT_NEAR(std::log(good.lens.lens.f / 420.0), 0.0, 0.008);
  EXPECT_LT(good.lens.sigma(0), known);
  EXPECT_LT(good.focal_surprise, 6.63);
}

TEST(GuessedCamera, AContradictionWidensAndIsNamed) {
  const DriveCalibration right = with_prior(430, 0.05);
  const DriveCalibration wrong = with_prior(590, 0.08);  // 0.34 off, 4.2 standard deviations
  EXPECT_GT(wrong.focal_surprise, 9.0);
  EXPECT_GT(wrong.lens.sigma(0), 2.0 * right.lens.sigma(0));
  EXPECT_LT(std::abs(std::log(wrong.lens.lens.f / 420.0)), 2.5 * wrong.lens.sigma(0));
  ASSERT_FALSE(wrong.notes.empty());
  EXPECT_THAT(wrong.notes.front(), HasSubstr("another focal length than the one that was given"));
  EXPECT_TRUE(right.notes.empty() || right.notes.front().find("another") == std::string::npos);
}

/// On a straight road no track shows the focal length; how far the drive goes does, over how high a
/// camera on a car may be.
TEST(GuessedCamera, SpeedsAndTheUsualHeightBoundIt) {
  test::SimulatedDriveOptions options;
  options.lens = {640, 360, 420.0, 319.5, 179.5, 0.0, 0.0};
  options.key_frames = 57;
  options.shake = 0.0;
  options.points = 2500;
  options.height = 1.5;
  TrackedDrive drive;
  drive.width = 640;
  drive.height = 360;
  drive.tracks = test::simulate_drive(options).tracks;
  for (int k = 0; k < options.key_frames; ++k) drive.key_ids.push_back(k);
  CalibrateOptions calibrate;
  calibrate.num_threads = 2;
  const DriveCalibration alone = calibrate_tracks(drive, calibrate);
  ASSERT_EQ(alone.sources.size(), 2U);
  EXPECT_EQ(alone.sources[0].name, "epipolar_geometry");
  EXPECT_EQ(alone.sources[1].name, "height_of_cars");
  EXPECT_FALSE(alone.mounting.height);
  EXPECT_FALSE(height_by(alone, "speeds"));
  drive.metres = MetresAlong{std::vector<double>(56, options.step), 0.01, false};
  const DriveCalibration moved = calibrate_tracks(drive, calibrate);
  ASSERT_EQ(moved.sources.size(), 3U);
  EXPECT_EQ(moved.sources[1].name, "speeds");
  EXPECT_TRUE(moved.sources[1].accepted);
  EXPECT_LT(moved.lens.sigma(0), 0.9 * alone.lens.sigma(0));
  EXPECT_LT(std::abs(std::log(moved.lens.lens.f / 420.0)), 3.0 * moved.lens.sigma(0));
  EXPECT_THAT(moved.focal_decided_by, HasSubstr("the speeds of the frames"));
  const auto height = height_by(moved, "speeds");
  ASSERT_TRUE(height);
  EXPECT_LT(std::abs(height->value - options.height), 3.0 * height->sigma);
}

}  // namespace
}  // namespace camber
