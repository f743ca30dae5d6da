#include "camber/drive/drive_tracks.h"

#include <gtest/gtest.h>

#include <cmath>

namespace camber {
namespace {

constexpr int kWidth = 1000;

/// A camera that drives 1 m a frame at 10 Hz past a vehicle, as windows of three frames see it.
struct Pass {
  std::vector<WindowMeasurement> windows;
  Trajectory trajectory;
  std::map<int, double> times;
};

/// @param place   m, of the vehicle in the first camera. @param speed  m/s, ahead.
/// @param factor  by which every estimate's distance is off.
Pass make_pass(int frames, const Eigen::Vector3d& place, double speed, double factor) {
  Pass out;
  out.trajectory.metric = true;
  for (int k = 0; k < frames; ++k) {
    TrajectoryPose pose;
    pose.frame = k;
    pose.status = Status::kOk;
    pose.world_from_camera = SE3(Eigen::Quaterniond::Identity(), {0, 0, 1.0 * k});
    out.trajectory.poses.push_back(pose);
    out.times[k] = 0.1 * k;
    WindowMeasurement w;
    w.reference = k;
    VehicleEstimate v;
    v.id = 1;
    v.vehicle_class = "car";
    v.box = {400, 100, 500, 150};
    const Eigen::Vector3d here = place + Eigen::Vector3d(0, 0, (0.1 * speed - 1.0) * k);
    v.pose.camera_from_vehicle = SE3(rotation_from_vector({0, -M_PI / 2, 0}), factor * here);
    v.pose.dimensions = {4.2, 1.8, 1.5};
    v.covariance = Eigen::Matrix<double, 9, 9>::Identity() * std::pow(0.03 * here.norm(), 2);
    w.vehicles.resize(1);
    w.vehicles[0].id = k;
    w.vehicles[0].vehicles = {v};
    for (const int other : {k - 1, k, k + 1}) {
      if (other < 0 || other >= frames) continue;
      w.frames.push_back(other);
      w.tracked.push_back({other, 1, 0});
    }
    out.windows.push_back(std::move(w));
  }
  return out;
}

TEST(DriveTracks, AParkedVehicleIsMeasuredByTheWayBetweenItsViews) {
  const Eigen::Vector3d place(3.0, 1.5, 30.0);
  const Pass pass = make_pass(22, place, 0.0, 0.96);  // each view is 4 % too near
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.tracks.size(), 1U);
  EXPECT_TRUE(found.tracks[0].parked);
  EXPECT_EQ(found.tracks[0].views.size(), 22U);
  const Eigen::Vector3d at = found.tracks[0].views[0].world_from_vehicle.translation();
  EXPECT_LT((at - place).norm(), 0.3);  // single views are 1.2 m off
  // The frame's own estimate is moved there as well.
  const VehicleEstimate& first = found.vehicles.frames[0].vehicles[0];
  EXPECT_LT((first.pose.bottom_center() - at).norm(), 1e-9);
  EXPECT_EQ(first.track, found.tracks[0].id);
}

/// The level ground 1.5 m below the camera.
void put_ground(Pass* pass) {
  for (WindowMeasurement& w : pass->windows) {
    for (VehicleEstimate& v : w.vehicles[0].vehicles) {
      v.plane = {Eigen::Vector3d(0, -1, 0), 1.5};
      v.plane_sigma_height = 0.05;
      v.status = Status::kOk;
    }
  }
}

DriveTrack only_track(const Pass& pass) {
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  EXPECT_EQ(found.tracks.size(), 1U);
  const bool rejected = !found.tracks[0].rejected.empty();
  EXPECT_EQ(found.num_rejected(), rejected ? 1U : 0U);
  for (const VehicleFrame& frame : found.vehicles.frames) {
    EXPECT_EQ(frame.vehicles[0].status == Status::kFailed, rejected);
    EXPECT_EQ(frame.vehicles[0].reason.find(found.tracks[0].rejected) != std::string::npos, true);
  }
  return found.tracks[0];
}

TEST(DriveTracks, WhatStandsHighAboveTheRoadIsRejected) {
  Pass pass = make_pass(22, {3.0, 1.5, 30.0}, 0.0, 1.0);
  put_ground(&pass);
  EXPECT_EQ(only_track(pass).rejected, "");
  pass = make_pass(22, {3.0, -0.5, 30.0}, 0.0, 1.0);  // 2 m: a window of a house
  put_ground(&pass);
  EXPECT_EQ(only_track(pass).rejected, "it is 2.0 m above the road");
  for (WindowMeasurement& w : pass.windows) w.vehicles[0].vehicles[0].plane_sigma_height = 0.8;
  EXPECT_EQ(only_track(pass).rejected, "");  // the ground is hardly known
}

TEST(DriveTracks, WhatHasNoSizeOfAVehicleIsRejected) {
  Pass pass = make_pass(8, {3.0, 1.5, 30.0}, 0.0, 1.0);
  put_ground(&pass);
  for (WindowMeasurement& w : pass.windows) {
    w.vehicles[0].vehicles[0].pose.dimensions = {1.0, 0.5, 0.4};
  }
  EXPECT_EQ(only_track(pass).rejected, "1.0 x 0.5 x 0.4 m are no size of a car");
  pass.trajectory.metric = false;  // 0.4 of what?
  EXPECT_EQ(only_track(pass).rejected, "");
}

TEST(DriveTracks, WhatIsFasterThanVehiclesIsRejected) {
  Pass pass = make_pass(15, {-2.0, 1.5, 20.0}, 35.0, 1.0);
  put_ground(&pass);
  EXPECT_EQ(only_track(pass).rejected, "");
  pass = make_pass(15, {-2.0, 1.5, 20.0}, 150.0, 1.0);
  put_ground(&pass);
  for (const DriveTrack& track :
       join_tracks(pass.windows, pass.trajectory, pass.times, kWidth).tracks) {
    EXPECT_EQ(track.rejected.substr(0, 11), "it moves at") << track.views.size();
  }
  pass = make_pass(2, {-2.0, 1.5, 20.0}, 150.0, 1.0);  // two views are no track
  put_ground(&pass);
  EXPECT_EQ(only_track(pass).rejected, "");
}

TEST(DriveTracks, AMovingVehicleKeepsItsOwnPlaces) {
  const Pass pass = make_pass(15, {-2.0, 1.5, 20.0}, 12.0, 1.0);
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.tracks.size(), 1U);
  EXPECT_FALSE(found.tracks[0].parked);
  const auto& views = found.tracks[0].views;
  EXPECT_NEAR((views.back().world_from_vehicle.translation() -
               views.front().world_from_vehicle.translation())
                  .norm(),
              12.0 * 1.4, 1e-6);
}

TEST(DriveTracks, AnOncomingVehicleHasTheSizeOfItsNearViews) {
  // From 60 m to 8: the ground is 8 % too near beyond 25 m, and the size with it.
  Pass pass = make_pass(27, {-2.0, 1.5, 60.0}, -10.0, 1.0);
  for (WindowMeasurement& w : pass.windows) {
    VehicleEstimate& v = w.vehicles[0].vehicles[0];
    const double factor = v.pose.bottom_center().norm() > 25.0 ? 0.92 : 1.0;
    v.pose.camera_from_vehicle.set_translation(factor * v.pose.bottom_center());
    v.pose.dimensions = {factor * 4.2, factor * 1.8, factor * 1.5};
    v.covariance.bottomRightCorner<3, 3>() = 0.04 * 0.04 * Eigen::Matrix3d::Identity();
  }
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.tracks.size(), 1U);
  EXPECT_FALSE(found.tracks[0].parked);
  EXPECT_NEAR(found.tracks[0].dimensions.width, 1.8, 0.05);
  const VehicleEstimate& far = found.vehicles.frames[0].vehicles[0];
  const double range = Eigen::Vector3d(-2.0, 1.5, 60.0).norm();
  EXPECT_NEAR(far.pose.bottom_center().norm(), range, 0.03 * range);
  EXPECT_EQ(far.pose.dimensions.width, found.tracks[0].dimensions.width);
  // Across the ray it stays where it was seen.
  EXPECT_NEAR(far.pose.bottom_center().x() / far.pose.bottom_center().z(), -2.0 / 60.0, 1e-9);
  const double sigma = std::sqrt(far.covariance(2, 2)) / range;
  EXPECT_GT(sigma, 0.01);
  EXPECT_LT(sigma, 0.04);  // 2 % of the angle, 2 % of the size; by the ground alone 12 %
}

TEST(DriveTracks, AParkedVehicleIsPlacedByViewsThatThePictureDoesNotCut) {
  const Eigen::Vector3d place(3.0, 1.5, 20.0);
  Pass pass = make_pass(16, place, 0.0, 1.0);
  for (std::size_t k = 9; k < pass.windows.size(); ++k) {  // what is left of it has its own centre
    VehicleEstimate& v = pass.windows[k].vehicles[0].vehicles[0];
    v.pose.camera_from_vehicle.set_translation(v.pose.bottom_center() +
                                               Eigen::Vector3d(-0.8, 0.0, 0.0));
    v.box = {850, 100, kWidth - 1.0, 300};
  }
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_TRUE(found.tracks.at(0).parked);
  EXPECT_LT((found.tracks[0].views[0].world_from_vehicle.translation() - place).norm(), 0.05);
  EXPECT_EQ(found.tracks[0].views.size(), 16U);  // placed in the others as well
  const DriveTracks misled = join_tracks(pass.windows, pass.trajectory, pass.times, 2 * kWidth);
  EXPECT_GT((misled.tracks.at(0).views[0].world_from_vehicle.translation() - place).norm(), 0.2);
}

TEST(DriveTracks, OneThatKeepsItsDistanceAheadMoves) {
  const Pass pass = make_pass(80, {-0.3, 1.5, 28.0}, 10.0, 1.0);
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.tracks.size(), 1U);
  EXPECT_FALSE(found.tracks[0].parked);
  EXPECT_NEAR(found.vehicles.frames[40].vehicles[0].pose.bottom_center().z(), 28.0, 0.5);
}

TEST(DriveTracks, EveryFrameOfAWindowHasItsVehicles) {
  // Windows about every third frame hold the vehicles of the frames beside as well. One of them
  // took something else for the road: its own views are twice as far away.
  Pass pass = make_pass(22, {3.0, 1.5, 30.0}, 0.0, 1.0);
  std::vector<WindowMeasurement> kept;
  for (std::size_t k = 1; k + 1 < pass.windows.size(); ++k) {
    const bool wrong = k == 10;
    if (k % 3 != 1) continue;
    WindowMeasurement w = pass.windows[k];
    w.frames.clear();
    w.vehicles.clear();
    w.tracked.clear();
    for (std::size_t other = k - 1; other <= std::min(k + 2, pass.windows.size() - 1); ++other) {
      VehicleFrame frame = pass.windows[other].vehicles[0];
      VehicleEstimate& v = frame.vehicles[0];
      if (wrong) v.pose.camera_from_vehicle.set_translation(2.0 * v.pose.bottom_center());
      w.frames.push_back(frame.id);
      w.tracked.push_back({frame.id, 1, 0});
      w.vehicles.push_back(std::move(frame));
    }
    pass.trajectory.scales.push_back({w.reference, 0.0, wrong ? 0.01 : 1.0, 0.0});
    kept.push_back(std::move(w));
  }
  const DriveTracks found = join_tracks(kept, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.vehicles.frames.size(), 22U);
  for (const VehicleFrame& frame : found.vehicles.frames) {
    ASSERT_EQ(frame.vehicles.size(), 1U) << frame.id;
    const double z = 30.0 - frame.id;
    // Frame 9 is in the window about frame 7 as well, 10 and 11 are in the wrong one alone.
    if (frame.id != 10 && frame.id != 11) {
      EXPECT_NEAR(frame.vehicles[0].pose.bottom_center().z(), z, 0.1 + 0.02 * z) << frame.id;
    }
  }
}

TEST(DriveTracks, AVehicleIsTakenOutOfAnothersTrack) {
  // For eight frames one that is parked behind it, 6 m beyond and a little aside, is taken for it.
  const Eigen::Vector3d place(3.0, 1.5, 32.0), behind(3.8, 1.5, 38.0);
  Pass pass = make_pass(24, place, 0.0, 1.0);
  const Pass other = make_pass(24, behind, 0.0, 1.0);
  for (std::size_t k = 8; k < 16; ++k) pass.windows[k].vehicles = other.windows[k].vehicles;
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.tracks.size(), 2U);
  for (const DriveTrack& track : found.tracks) {
    const bool first = track.views[0].frame == 0;
    EXPECT_TRUE(track.parked);
    EXPECT_EQ(track.views.size(), first ? 16U : 8U);
    const Eigen::Vector3d& at = track.views[0].world_from_vehicle.translation();
    EXPECT_LT((at - (first ? place : behind)).norm(), 0.1);
  }
  // In a vehicle's own units nothing tells how far apart they are.
  pass.trajectory.metric = false;
  EXPECT_EQ(join_tracks(pass.windows, pass.trajectory, pass.times, kWidth).tracks.size(), 1U);
}

TEST(DriveTracks, TwoDetectionsOfAFrameAreNeverOneTrack) {
  Pass pass = make_pass(4, {0, 1.5, 20}, 0.0, 1.0);
  for (WindowMeasurement& w : pass.windows) {
    w.vehicles[0].vehicles.push_back(w.vehicles[0].vehicles[0]);
    w.vehicles[0].vehicles[1].id = 2;
    w.tracked.push_back({w.reference, 2, 1});
  }
  pass.windows[2].tracked.push_back({2, 2, 0});  // one window mistakes it
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  for (const VehicleFrame& frame : found.vehicles.frames) {
    ASSERT_EQ(frame.vehicles.size(), 2U);
    EXPECT_NE(frame.vehicles[0].track, frame.vehicles[1].track);
  }
}

TEST(DriveTracks, EveryFrameHasItsEntry) {
  Pass pass = make_pass(6, {0, 1.5, 20}, 0.0, 1.0);
  pass.windows.erase(pass.windows.begin() + 3);
  const DriveTracks found = join_tracks(pass.windows, pass.trajectory, pass.times, kWidth);
  ASSERT_EQ(found.vehicles.frames.size(), 6U);
  EXPECT_TRUE(found.vehicles.frames[3].vehicles.empty());
}

}  // namespace
}  // namespace camber
