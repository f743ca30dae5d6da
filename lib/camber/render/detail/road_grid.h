#pragma once

#include <utility>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/road/road_surface.h"

namespace camber {

/// Lines on the patches of a road, in the camera of an image: every metre (or unit) across to 12 of
/// them ahead, then every five, and every metre along, counted from the reference camera.
struct RoadGrid {
  using Line = std::pair<Eigen::Vector3d, Eigen::Vector3d>;
  std::vector<Line> fine, coarse;  ///< coarse: every ten ahead
  /// Right ends of the coarse lines that are farthest to the right, by their distance ahead.
  std::vector<std::pair<int, Eigen::Vector3d>> labels;
};

/// @param surface  in the frame of a reference camera.
RoadGrid road_grid(const RoadSurface& surface, const SE3& camera_from_reference);

}  // namespace camber
