#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"

namespace camber::test {

struct SimulatedMatchesOptions {
  int step = 4;                           ///< px, of the grid
  double noise_px = 0.1;                  ///< standard deviation of each coordinate of a match
  double outliers = 0.2;                  ///< share of the grid points whose matches are wrong
  double nearest = 6.0, farthest = 40.0;  ///< m, depths
  std::uint64_t seed = 1;
};

/// Correspondences without images: every grid point has a random depth and is projected into the
/// other frames.
struct SimulatedMatches {
  Correspondences matches;
  std::vector<double> depths;         ///< m, true, one a grid point
  std::vector<std::uint8_t> outlier;  ///< one a grid point; non-zero: its matches are wrong
  std::vector<std::uint8_t> all;      ///< one a grid point, all 1
};

/// @param frame_from_reference  one pose a frame, m; the identity at `reference`.
SimulatedMatches simulate_matches(const PinholeCamera& camera,
                                  const std::vector<SE3>& frame_from_reference, int reference,
                                  const SimulatedMatchesOptions& options);

/// A camera of 640 x 240 pixels.
PinholeCamera small_camera();

/// Three frames of a car that drives about 1 m a frame in a slight bend; the reference is frame 1.
std::vector<SE3> driving_motion();

}  // namespace camber::test
