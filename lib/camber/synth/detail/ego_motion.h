#pragma once

#include <memory>
#include <vector>

#include "camber/synth/detail/driven_path.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// How the camera's car drives: its rear axle is on a path, evenly fast.
struct EgoMotion {
  std::unique_ptr<DrivenPath> path;
  double speed = 0.0;         ///< m/s
  double begin = 0.0;         ///< distance on the path at frame 0
  double camera_ahead = 0.0;  ///< m before the rear axle

  double distance(int frame, double frame_rate) const { return begin + speed / frame_rate * frame; }
};

/// The drive that the options ask for. The road must outlive it.
EgoMotion plan_ego_motion(const WorldOptions& options, const RoadModel& road);

/// How the camera is turned in its level axes above the road, rad (see MountingOptions), and how
/// high it is, m.
struct CameraAttitude {
  double pitch = 0.0, yaw = 0.0, roll = 0.0, height = 1.65;
};

/// The camera above a place of the road. @param station a guess of the place's
SynthView view_above_road(const RoadModel& road, const Eigen::Vector2d& place, double station,
                          double heading, const CameraAttitude& attitude);

/// The camera at every frame: on its path, in its mounting, moved by its springs by a tenth of a
/// degree and a few millimetres.
std::vector<SynthView> drive_camera(const WorldOptions& options, const RoadModel& road,
                                    const EgoMotion& motion);

}  // namespace camber
