// The motion stage on exact correspondences of a plane between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/motion.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

double rotation_error(const SE3& a, const SE3& b) {
  return rotation_to_vector((a.inverse() * b).rotation()).norm();
}

void expect_same_motion(const MotionEstimate& found, const MotionEstimate& truth) {
  ASSERT_EQ(found.frame_from_reference.size(), truth.frame_from_reference.size());
  for (std::size_t k = 0; k < truth.frame_from_reference.size(); ++k) {
    const SE3 &a = found.frame_from_reference[k], &b = truth.frame_from_reference[k];
    EXPECT_LT(rotation_error(a, b), 2e-5) << "image " << k;
    EXPECT_LT((a.translation() - b.translation()).norm(), 5e-4) << "image " << k;
  }
}

/// Matches inside a box as if what is seen there moved by itself.
void move_inside(const Box2& box, const Eigen::Vector3d& shift, MadeDrive* drive) {
  const PinholeCamera& camera = drive->frames.camera;
  for (MatchedImage& match : drive->matches.matches) {
    const auto f = static_cast<std::size_t>(match.frame);
    const SE3 pose = metric_pose(drive->motion, f, drive->metres_per_baseline);
    for (std::size_t i = 0; i < drive->depths.size(); ++i) {
      const Eigen::Vector2d pixel = drive->matches.pixels[i].cast<double>();
      if (!box.contains(pixel)) continue;
      const double direction = f < drive->frames.reference ? -1.0 : 1.0;
      const auto p =
          camera.project(pose * (drive->depths[i] * camera.ray(pixel) + direction * shift));
      match.round_trip_px[i] = p ? 0.0f : std::numeric_limits<float>::infinity();
      if (p) match.pixels[i] = p->cast<float>();
    }
  }
}

TEST(MotionStage, RecoversThePosesFromExactMatches) {
  const MadeDrive drive = make_drive({});
  const MotionEstimate found = stages::motion(drive.frames, drive.matches, {});
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  expect_same_motion(found, drive.motion);
  EXPECT_FALSE(found.metres_per_baseline);
}

TEST(MotionStage, LeavesOutWhatIsOnVehicles) {
  // Three quarters of the image move by themselves, all alike.
  MadeDriveOptions options;
  VehicleDetection bus;
  bus.box = {0.0, 0.0, 480.0, 239.0};
  options.vehicles = {{}, {bus}, {}};
  MadeDrive drive = make_drive(options);
  move_inside(bus.box, {0.6, 0.0, 0.3}, &drive);
  expect_same_motion(stages::motion(drive.frames, drive.matches, {}), drive.motion);
}

TEST(MotionStage, TakesKnownPosesWithTheirMetres) {
  MadeDrive drive = make_drive({});
  const SE3 world_from_reference(rotation_from_vector({0.1, -0.2, 0.3}), {5.0, 6.0, 7.0});
  for (std::size_t k = 0; k < drive.frames.size(); ++k) {
    drive.frames.frames[k].world_from_camera =
        world_from_reference * metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
  }
  // Matches have no say in known poses.
  for (MatchedImage& match : drive.matches.matches) {
    std::fill(match.round_trip_px.begin(), match.round_trip_px.end(),
              std::numeric_limits<float>::infinity());
  }
  const MotionEstimate found = stages::motion(drive.frames, drive.matches, {});
  ASSERT_TRUE(found.metres_per_baseline);
  EXPECT_NEAR(*found.metres_per_baseline, 1.2, 1e-9);
  expect_same_motion(found, drive.motion);
  const MotionEstimate again = stages::motion_again(drive.frames, drive.matches, found, {});
  EXPECT_EQ(again.metres_per_baseline, found.metres_per_baseline);
  expect_same_motion(again, drive.motion);
}

TEST(MotionStage, PosesThatTheMatchesContradictAreLeftAsideByName) {
  MadeDrive drive = make_drive({});
  const auto give_poses = [&](double turn_of_last) {
    for (std::size_t k = 0; k < drive.frames.size(); ++k) {
      drive.frames.frames[k].world_from_camera =
          metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
    }
    SE3& last = *drive.frames.frames.back().world_from_camera;
    last = last * SE3(rotation_from_vector({0.6 * turn_of_last, 0.0, 0.8 * turn_of_last}),
                      Eigen::Vector3d::Zero());
  };
  give_poses(0.0);
  stages::check_poses(drive.matches, {}, &drive.frames);
  EXPECT_TRUE(drive.frames.has_poses());
  EXPECT_EQ(drive.frames.contradicted_poses, "");
  give_poses(0.017);
  stages::check_poses(drive.matches, {}, &drive.frames);
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_THAT(drive.frames.contradicted_poses,
              StartsWith("frame " + std::to_string(drive.frames.frames.back().id) + ": "));
  EXPECT_THAT(drive.frames.contradicted_poses, Not(HasSubstr(";")));  // the other one is right
  expect_same_motion(stages::motion(drive.frames, drive.matches, {}), drive.motion);
}

TEST(MotionStage, PosesOfOtherMomentsAreKnownByTheirTurns) {
  MadeDrive drive = make_drive({});
  // Poses that turn by so much more from frame to frame, or all of them in other axes.
  const auto give_poses = [&](double turn, const SE3& axes) {
    drive.frames.poses_of_other_moments = false;
    for (std::size_t k = 0; k < drive.frames.size(); ++k) {
      const SE3 pose = metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
      drive.frames.frames[k].world_from_camera =
          pose *
          SE3(rotation_from_vector({0.0, turn * static_cast<double>(k), 0.0}),
              Eigen::Vector3d::Zero()) *
          axes;
    }
    stages::check_poses(drive.matches, {}, &drive.frames);
  };
  const SE3 none;
  give_poses(0.0, none);
  EXPECT_FALSE(drive.frames.poses_of_other_moments);
  EXPECT_TRUE(drive.frames.has_poses());
  give_poses(0.021, none);
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_TRUE(drive.frames.poses_of_other_moments);
  // A body's axes in place of the camera's: its turns are those of the images, its lengths count.
  give_poses(0.0, SE3(rotation_from_vector({1.2, -1.2, 1.2}), Eigen::Vector3d::Zero()));
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_FALSE(drive.frames.poses_of_other_moments);
}

/// A camera that drives in a slight bend, its pitch and roll those of a vehicle on its springs.
std::vector<SE3> on_springs(const std::vector<double>& pitch) {
  std::vector<SE3> out;
  for (std::size_t k = 0; k < pitch.size(); ++k) {
    const double s = static_cast<double>(k);
    out.emplace_back(
        rotation_from_vector({pitch[k], 0.004 * s, -0.7 * pitch[pitch.size() - 1 - k]}),
        Eigen::Vector3d(0.0016 * s * s, 0.0, 0.8 * s));
  }
  return out;
}

/// Whether poses are taken for those of other moments than a camera's motion by the matches.
bool are_of_other_moments(const std::vector<SE3>& images, const std::vector<SE3>& poses) {
  MadeDriveOptions options;
  options.stations = {-1.6, -0.8, 0.0, 0.8, 1.6};
  options.reference = 2;
  MadeDrive drive = make_drive(options);
  Scene scene;
  for (std::size_t k = 0; k < images.size(); ++k) {
    drive.frames.frames[k].world_from_camera = poses[k];
    drive.motion.frame_from_reference[k] = images[k].inverse() * images[2];
  }
  scene.frames = drive.frames.frames;
  drive.frames.contradicted_poses = "frame 0: few agree";
  stages::check_turns(scene, drive.motion, &drive.frames);
  return drive.frames.poses_of_other_moments;
}

// rad, of five frames: up to 0.3 degrees from one to the next, as on real roads.
const std::vector<double> kSprings = {0.002, -0.003, 0.001, 0.003, -0.002};
const std::vector<double> kOtherSprings = {-0.002, 0.002, 0.003, -0.001, 0.002};

TEST(MotionStage, StraightOnTheTurnsOnSpringsTellOtherMoments) {
  const std::vector<SE3> images = on_springs(kSprings);
  EXPECT_FALSE(are_of_other_moments(images, images));
  EXPECT_TRUE(are_of_other_moments(images, on_springs(kOtherSprings)));
  // A body's axes in place of the camera's, and the noise of an inertial unit.
  const SE3 axes(rotation_from_vector({1.2, -1.2, 1.2}), Eigen::Vector3d::Zero());
  std::vector<SE3> body = images, other = on_springs(kOtherSprings);
  for (std::size_t k = 0; k < body.size(); ++k) {
    const double noise = k % 2 == 0 ? 4e-4 : -4e-4;
    body[k] =
        body[k] * SE3(rotation_from_vector({noise, -noise, noise}), Eigen::Vector3d::Zero()) * axes;
    other[k] = other[k] * axes;
  }
  EXPECT_FALSE(are_of_other_moments(images, body));
  EXPECT_TRUE(are_of_other_moments(images, other));
}

TEST(MotionStage, OneWrongPoseAndPosesThatAreSmoothedKeepTheirMoments) {
  const std::vector<SE3> images = on_springs(kSprings);
  for (std::size_t wrong = 0; wrong < images.size(); ++wrong) {
    std::vector<SE3> poses = images;
    poses[wrong] =
        poses[wrong] * SE3(rotation_from_vector({0.01, 0.0, 0.012}), Eigen::Vector3d::Zero());
    EXPECT_FALSE(are_of_other_moments(images, poses)) << wrong;
  }
  // By a satellite receiver's course: it knows nothing of the springs.
  EXPECT_FALSE(are_of_other_moments(images, on_springs({0.0, 0.0, 0.0, 0.0, 0.0})));
}

TEST(MotionStage, AStationaryCameraHasNoAnswer) {
  MadeDriveOptions options;
  options.stations = {-1e-4, 0.0, 1e-4};
  const MadeDrive drive = make_drive(options);
  EXPECT_THROW(stages::motion(drive.frames, drive.matches, {}), NoAnswerError);
}

TEST(MotionStage, AgainStartsFromAMotionThatIsNearlyRight) {
  const MadeDrive drive = make_drive({});
  MotionEstimate start = drive.motion;
  start.frame_from_reference[2] =
      SE3(rotation_from_vector({0.002, -0.001, 0.001}), {0.01, -0.01, 0.0}) *
      start.frame_from_reference[2];
  expect_same_motion(stages::motion_again(drive.frames, drive.matches, start, {}), drive.motion);
}

}  // namespace
}  // namespace camber
