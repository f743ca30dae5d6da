#pragma once

#include <string>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/import/formats/trajectory.h"

namespace camber {

/// A camera of a run.
struct StampedPose {
  int id = 0;
  double time_s = 0.0;
  SE3 world_from_camera;  ///< m
};

/// Rows "time tx ty tz qx qy qz qw" (TUM RGB-D benchmark).
std::string encode_tum(const std::vector<StampedPose>& poses);
/// Twelve numbers a row: the upper three rows of world_from_camera (KITTI odometry).
std::string encode_kitti_poses(const std::vector<StampedPose>& poses);
/// `frame,time_s,x_m,y_m,z_m,qx,qy,qz,qw` with a line of names.
std::string encode_pose_csv(const std::vector<StampedPose>& poses);

/// GPX 1.1 of one track; times are written where they are known, as UTC.
std::string encode_gpx(const std::vector<GeoPoint>& points);

}  // namespace camber
