#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "camber/motion/motion.h"

namespace camber {

/// Where a camera was on its path, in plan, seen from its reference pose.
struct PlaceOnPath {
  double ahead = 0.0, right = 0.0;  ///< m, by the direction of travel at the reference
  std::optional<double> turn;       ///< rad, how far the camera has turned there, to the right
};

struct PathNoise {
  double curvature = 0.03;  ///< 1/m, standard deviation of a driven path's, > 0
  double place = 0.02;      ///< m, of a position across the path, > 0
  double turn = 0.005;      ///< rad, of a camera's turn against the path's, > 0
};

/// Curvature in plan of a camera's path at its reference pose, 1/m, positive: to the right. Least
/// squares over places and turns with a path that is straight before them.
double path_curvature(const std::vector<PlaceOnPath>& path, const PathNoise& noise = {});

/// The places of a motion. @param metres_per_baseline  > 0.
std::vector<PlaceOnPath> path_places(const MotionEstimate& motion, std::size_t reference,
                                     double metres_per_baseline);

}  // namespace camber
