// What gives a run its metres, on a plane between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/errors.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_photometric;
using test::MadeDrive;
using test::make_drive;
using test::paint_markings;
using test::report_of;

TEST(ScaleStage, TheCameraHeightGivesTheMetres) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 1e-3);
  // 10 mm of 1.65 m, and the ego plane's 0.2 %.
  EXPECT_NEAR(scaled.road.scale_sigma(), std::hypot(0.01 / 1.65, 0.002), 3e-4);
  ASSERT_TRUE(report_of(scaled.reports, "camera_height"));
  EXPECT_TRUE(report_of(scaled.reports, "camera_height")->accepted);
  const UncertainPlane ego = scaled.road.ego();
  EXPECT_NEAR(ego.plane.offset, 1.65, 0.002);
  EXPECT_LT(angle_between(ego.plane.normal, drive.plane.normal), 1e-3);
  // A wrong first scale of the ground stage is of no consequence.
  ground.ground.metres_per_baseline = 1.1;
  EXPECT_NEAR(stages::scale(drive.frames, drive.matches, ground, {}).road.metres_per_baseline(),
              1.2, 0.005);
}

TEST(ScaleStage, AHeightKnownBadlyIsSaidToBe) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height_sigma = 0.165;
  const ScaledRoad scaled =
      stages::scale(drive.frames, drive.matches, exact_photometric(drive), {});
  EXPECT_NEAR(scaled.road.scale_sigma(), 0.1, 0.003);
}

TEST(ScaleStage, WithoutASourceOfMetresLengthsAreInNominalHeights) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height.reset();
  const ScaledRoad scaled =
      stages::scale(drive.frames, drive.matches, exact_photometric(drive), {});
  EXPECT_FALSE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 2e-3);  // 1.65 m is the nominal height
  ASSERT_TRUE(report_of(scaled.reports, "camera_height"));
  EXPECT_FALSE(report_of(scaled.reports, "camera_height")->accepted);
  EXPECT_EQ(report_of(scaled.reports, "camera_height")->reason, "not given");
}

TEST(ScaleStage, KnownPosesTakeThePlaceOfTheCameraHeight) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height.reset();
  PhotometricGround ground = exact_photometric(drive);
  ground.motion.metres_per_baseline = ground.ground.metres_per_baseline = 1.3;
  ground.motion.baseline_sigma = 0.01;
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.3, 1e-3);
  EXPECT_NEAR(scaled.road.scale_sigma(), 0.01, 2e-4);
  ASSERT_TRUE(report_of(scaled.reports, "known_poses"));
  EXPECT_TRUE(report_of(scaled.reports, "known_poses")->accepted);
  EXPECT_FALSE(report_of(scaled.reports, "camera_height"));
}

TEST(ScaleStage, WithoutAPlaneUnderTheCameraThereIsNoAnswer) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.ego.points = 0;
  EXPECT_THROW(stages::scale(drive.frames, drive.matches, ground, {}), NoAnswerError);
}

TEST(ScaleStage, MarkingsOfKnownSizeGiveMetresWithoutACameraHeight) {
  MadeDrive drive = make_drive({});
  paint_markings(&drive);
  drive.frames.known.camera_height.reset();
  drive.frames.known.markings = {3.0, 6.0, 0.12, 0.5, 0.5};
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.metres_per_baseline = 1.1;  // all that is known is that a car carries the camera
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  ASSERT_TRUE(report_of(scaled.reports, "lane_markings"));
  EXPECT_TRUE(report_of(scaled.reports, "lane_markings")->accepted)
      << report_of(scaled.reports, "lane_markings")->reason;
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 0.03 * 1.2);
  EXPECT_LT(scaled.road.scale_sigma(), 0.05);
}

TEST(ScaleStage, StrokesHoldTheScaleWhateverTheFocalLengthAndCrossingsDoNot) {
  MadeDrive drive = make_drive({});
  paint_markings(&drive);
  drive.frames.known.camera_height_sigma = 0.165;
  const auto scaled = [&](const LaneMarkingSizes& sizes) {
    drive.frames.known.markings = sizes;
    return stages::scale(drive.frames, drive.matches, exact_photometric(drive), {});
  };
  EXPECT_EQ(scaled({}).scale_by_focal, 1.0);
  const ScaledRoad strokes = scaled({3.0, 6.0, 0.12, 0.0, 0.0});
  ASSERT_GT(strokes.markings.dashes, 0);
  ASSERT_EQ(strokes.markings.crossings, 0);
  EXPECT_LT(strokes.scale_by_focal, 0.5);
  const ScaledRoad both = scaled({3.0, 6.0, 0.12, 0.5, 0.5});
  ASSERT_GT(both.markings.dashes, 0);
  ASSERT_GT(both.markings.crossings, 0);
  EXPECT_EQ(both.scale_by_focal, 1.0);
}

}  // namespace
}  // namespace camber
