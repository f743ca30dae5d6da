#pragma once

#include <Eigen/Core>

namespace camber {

/// Where a unit vector points that cannot be gravity's up in a camera that looks along a road:
/// "down" (y > 0) or "forward" (within 26 degrees of the camera's axis, so that it looks up too
/// steeply to see a road); nullptr: it can be.
inline const char* why_not_up(const Eigen::Vector3d& up) {
  constexpr double kMostForward = 0.9;
  if (up.y() > 0.0) return "down";
  return up.z() > kMostForward ? "forward" : nullptr;
}

}  // namespace camber
