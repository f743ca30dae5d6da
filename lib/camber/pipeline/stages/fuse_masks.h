#pragma once

#include <cstdint>
#include <vector>

#include "camber/pipeline/stages/ground.h"

namespace camber::stages {

/// What a network calls road against where it lies.
struct MaskFusionOptions {
  double most_height = 0.2;  ///< m above or below the road's surface, > 0
  double sigmas = 1.0;       ///< of a cell's height, beside most_height
  double half_width = 2.5;   ///< m: the driven part, which carries the surface along the road
  /// m, to each side: it gives the cross slope, and nothing nearer is off.
  double slope_width = 3.5;
  double max_sigma = 0.3;                ///< m: heights that are known worse are not used
  int cell_width = 16, cell_height = 8;  ///< px: one match alone may be wrong
  int least_points = 3;                  ///< of a cell
  int least_cells = 8;                   ///< that touch: what is smaller may be a wrong match
  /// Of the cells from the outer edge of what is seen up to a cell that is off, in its row: those
  /// on the surface over those off it, at most. What has road beyond it is no side street but the
  /// shadow of something that moves.
  double most_road_beyond = 0.5;
};

/// Grid points of the ground that lie off the road's surface by more than is allowed: side streets,
/// pavements and walls that a mask calls road. The surface is a profile of heights along the road
/// ahead, medians of the driven part, with one cross slope; beyond the last part of it that is seen
/// nothing is off.
/// @param ego                 plane under the camera, up to scale, reference camera.
/// @param metres_per_baseline > 0.
/// @return one byte a grid point, non-zero: off.
std::vector<std::uint8_t> off_road_surface(const Correspondences& matches, const GroundPoints& seen,
                                           const Plane& ego, const Eigen::Vector3d& travel,
                                           double metres_per_baseline,
                                           const MaskFusionOptions& options = {});

/// Takes the pixels around those grid points off the reference image's ground, and the points off
/// `seen`. Masks that are not a network's stay as they are.
void fuse_masks(const Correspondences& matches, const MotionEstimate& motion, const Ground& ground,
                LoadedFrames* frames, GroundPoints* seen);

}  // namespace camber::stages
