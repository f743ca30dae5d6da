#include "camber/drive/drive_frames.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "camber/drive/drive_pictures.h"

namespace camber {
namespace {

constexpr double kHeight = 1.5;  // m

/// Frames 1 m apart on a plane; windows about some of them.
struct Drive {
  Scene scene;
  Trajectory trajectory;
  std::vector<WindowMeasurement> windows;
  std::map<int, double> factors;
};

/// @param camera_from_level  how the camera is mounted.
Drive make_drive(int frames, const std::vector<int>& references,
                 const Eigen::Quaterniond& camera_from_level) {
  Drive out;
  out.trajectory.metric = true;
  const Eigen::Vector3d up = camera_from_level * Eigen::Vector3d(0, -1, 0);
  const Eigen::Vector3d ahead = camera_from_level * Eigen::Vector3d(0, 0, 1);
  for (int k = 0; k < frames; ++k) {
    SceneFrame frame;
    frame.id = k;
    out.scene.frames.push_back(frame);
    TrajectoryPose pose;
    pose.frame = k;
    pose.status = Status::kOk;
    pose.measured = true;
    pose.world_from_camera = SE3(Eigen::Quaterniond::Identity(), 1.0 * k * ahead);
    out.trajectory.poses.push_back(pose);
  }
  for (const int reference : references) {
    WindowMeasurement w;
    w.reference = reference;
    w.log_scale = 0.0;
    UncertainPlane ego;
    ego.plane.normal = up;
    ego.plane.offset = kHeight;
    ego.centroid = -kHeight * up;
    UncertainPlane::make_axes(up, ahead, &ego.axis1, &ego.axis2);
    ego.covariance = 1e-6 * Eigen::Matrix3d::Identity();
    w.ego = ego;
    out.windows.push_back(w);
    out.factors[reference] = 1.0;
  }
  return out;
}

TEST(DriveFrames, TheRoadUnderFramesBetweenWindowsIsThatOfTheWindowsBeside) {
  const Drive drive = make_drive(10, {0, 3, 6}, Eigen::Quaterniond::Identity());
  const EgoRoads roads = ego_roads(drive.windows, drive.trajectory, drive.factors);
  ASSERT_EQ(roads.size(), 10U);  // frame 9 by window 6
  for (const auto& [frame, road] : roads) {
    EXPECT_NEAR(road.plane.plane.offset, kHeight, 1e-9) << frame;
    EXPECT_NEAR(road.plane.plane.normal.y(), -1.0, 1e-9) << frame;
  }
}

TEST(DriveFrames, ContradictedWindowsGiveNoRoad) {
  Drive drive = make_drive(20, {0, 16}, Eigen::Quaterniond::Identity());
  drive.factors.erase(16);
  const EgoRoads roads = ego_roads(drive.windows, drive.trajectory, drive.factors);
  EXPECT_EQ(roads.count(16), 0U);
  EXPECT_EQ(roads.count(4), 1U);
  EXPECT_EQ(roads.count(10), 0U);
}

TEST(DriveFrames, RollIsPositiveWhereTheRightSideIsDownAndPitchWhereTheAxisRises) {
  const double roll = 0.03, pitch = 0.05;
  // About the optical axis, x towards y (down); about x, z towards -y (up).
  const Eigen::Quaterniond mounted =
      Eigen::Quaterniond(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ())).inverse();
  const Eigen::Quaterniond raised =
      Eigen::Quaterniond(Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX())).inverse();
  const auto document_of = [](const Drive& drive) {
    return drive_document(drive.scene, drive.trajectory, drive.windows, drive.factors,
                          ego_roads(drive.windows, drive.trajectory, drive.factors),
                          drive.windows[0].ego->plane.normal);
  };
  const DriveDocument rolled = document_of(make_drive(4, {0, 3}, mounted));
  EXPECT_NEAR(rolled.roll.value, roll, 1e-9);
  EXPECT_NEAR(rolled.frames[1].roll.value, roll, 1e-9);
  EXPECT_NEAR(rolled.pitch.value, 0.0, 1e-9);
  const DriveDocument pitched = document_of(make_drive(4, {0, 3}, raised));
  EXPECT_NEAR(pitched.pitch.value, pitch, 1e-9);
  EXPECT_NEAR(pitched.roll.value, 0.0, 1e-9);
}

TEST(DriveFrames, AFilmPassesAsFastAsTheDrive) {
  DriveDocument drive;
  for (const double time : {7.0, 7.04, 7.12, 7.16}) {  // one frame was lost
    DriveFrame frame;
    frame.time_s = time;
    drive.frames.push_back(frame);
  }
  EXPECT_NEAR(film_rate(drive), 3.0 / 0.16, 1e-9);
  drive.frames.resize(1);
  EXPECT_EQ(film_rate(drive), 10.0);
}

}  // namespace
}  // namespace camber
