#pragma once

#include <cstdint>
#include <vector>

#include "camber/synth/road_model.h"

namespace camber {

/// The camera's car at a frame of a drive.
struct DriveState {
  double station = 0.0;  ///< m, of the rear axle
  double speed = 0.0;    ///< m/s along the road
  double pitch = 0.0;    ///< rad, by braking and accelerating; positive: its front is up
};

struct DriveMotionOptions {
  std::uint64_t seed = 0;
  int num_frames = 1;
  double frame_rate = 10.0;
  double speed = 9.0;  ///< m/s, where the road is free
  int standstills = 0;
};

/// How fast a car drives along a road: slower in bends, with standstills of 1.5 to 10 s, 1.5 m/s^2
/// faster and 2 to 4 m/s^2 slower at most. Pitches as a body on springs does.
std::vector<DriveState> drive_along(const RoadProfile& road, const DriveMotionOptions& options);

/// The same for given stations of the frames.
std::vector<DriveState> drive_by_stations(const std::vector<double>& stations, double frame_rate);

/// Lateral offset in its lane, m: wanders by a quarter of a metre, a function of the station.
double lane_offset(double station, double lane, std::uint64_t seed);

}  // namespace camber
