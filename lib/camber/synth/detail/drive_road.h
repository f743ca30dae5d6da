#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/synth/road_profile.h"

namespace camber {

inline constexpr double kDriveBefore = 40.0;   ///< m of road before station 0
inline constexpr double kDriveBeyond = 340.0;  ///< m beyond the last station that is driven

/// A road for a drive of a length (m): straights, bends, corners, hills and banks after one
/// another, within 80 degrees of its first direction, so that it never meets itself.
/// @param speed  m/s: bends and vertical curves suit it
RoadProfile draw_drive_road(std::uint64_t seed, double length, double speed);

/// A road under a path of cameras, and the station of each frame.
struct FollowedRoad {
  RoadProfile profile;
  std::vector<double> stations;
};
/// @param poses  world_from_camera; the first camera's up is taken for the world's.
/// @param lane   offset of the path from the road's centreline, m, positive to the left
/// @throws NoAnswerError for a path of less than 5 m; std::invalid_argument for one that climbs by
/// more than 0.6 rad.
FollowedRoad follow_path(const std::vector<SE3>& poses, double lane);

}  // namespace camber
