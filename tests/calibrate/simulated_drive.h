#pragma once

#include <cstdint>
#include <vector>

#include "camber/calibrate/drive_lens.h"
#include "camber/calibrate/feature_tracks.h"
#include "camber/calibrate/window_bundle.h"
#include "camber/geometry/se3.h"

namespace camber::test {

struct SimulatedDriveOptions {
  DriveLens lens;
  int key_frames = 29;
  double step = 0.9;     ///< m
  double turn = 0.0;     ///< rad a step, to the right
  double shake = 0.004;  ///< rad, of pitch and roll from frame to frame, standard deviation
  double pitch = 0.0, yaw = 0.0, roll = 0.0;  ///< of the mounting, rad; Mounting's signs
  double height = 1.4;                        ///< m
  double pixel_sigma = 0.2;                   ///< px
  int points = 6000;                          ///< beside and on the road
  std::uint64_t seed = 0;
};

/// Feature tracks of points beside and on a level road, over key frames of a camera on a car.
struct SimulatedDrive {
  std::vector<FeatureTrack> tracks;
  std::vector<SE3> camera_from_world;   ///< one a key frame, m
  std::vector<Eigen::Vector3d> points;  ///< of the tracks, world
};

SimulatedDrive simulate_drive(const SimulatedDriveOptions& options);

/// Windows of `count` key frames with their true poses and points; lengths in the longest baseline.
std::vector<CalibrationWindow> true_windows(const SimulatedDrive& drive, std::size_t count);

}  // namespace camber::test
