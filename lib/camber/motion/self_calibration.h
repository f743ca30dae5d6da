#pragma once

#include <cstdint>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"

namespace camber {

/// What the epipolar geometry of a turning camera knows of its focal length.
struct FocalLengthEstimate {
  /// kNotRun: the camera turns by less than MatchNoise::least_turn, or does not move; kFailed: too
  /// few matches, or no convergence.
  Status status = Status::kNotRun;
  double factor = 1.0;  ///< on the camera's focal length, > 0
  /// Of the factor's logarithm, by the matches alone; large where the camera hardly turns (along a
  /// straight line every focal length gives the same epipolar lines) or looks along the plane in
  /// which it moves (Sturm, "Critical motion sequences for the self-calibration of cameras and
  /// stereo systems with variable focal length", BMVC 1999).
  double sigma = 0.0;
  double gain = 0.0;  ///< log likelihood ratio of that factor over 1, >= 0
  int matches = 0;    ///< that were used, over all images
};

/// Self-calibration of the focal length (Hartley and Zisserman, "Multiple View Geometry", 2nd ed.,
/// section 19.3): Sampson errors of matches of points that stand still, over one common factor on
/// the focal length and each image's rotation and direction of travel, with a Cauchy loss.
/// @param usable  one entry a grid point; 0 where the point may belong to something that moves.
/// @param motion  of the camera as it is given: the start.
/// @throws std::invalid_argument for sizes that disagree.
FocalLengthEstimate estimate_focal_length(const PinholeCamera& camera,
                                          const Correspondences& matches,
                                          const std::vector<std::uint8_t>& usable,
                                          const MotionEstimate& motion,
                                          const MatchNoise& noise = {});

}  // namespace camber
