#pragma once

#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"
#include "camber/motion/motion.h"

namespace camber {

struct RoadSweepOptions {
  double half_width = 3.0;  ///< of the road that is compared, camera heights, > 0: lanes' lines too
  double reach = 12.0;      ///< ahead, camera heights, > 0
  double least_log_baseline = -4.0, greatest_log_baseline = 2.5;
  /// Travel between two images that are compared, camera heights: farther apart too little of the
  /// road is in both.
  double greatest_travel = 6.0;
  /// Limits for an informative sweep.
  double least_correlation = 0.2;
  double least_lead = 0.15;  ///< of the best correlation over that of any other baseline
  /// Of three, the mean that is taken off each has a third of itself: both windows of three that
  /// were informative and wrong, of a drive and of a made street, were 28 and 35 % off.
  int least_images = 4;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
};

struct RoadSweepResult {
  double log_baseline = 0.0;  ///< logarithm of the motion's unit of length over the camera's height
  double correlation = -1.0;  ///< of all images over the road, with that
  /// The best correlation of a baseline that differs by more than a fifth, half the resolution.
  double rival = -1.0;
  double lead = 0.0;         ///< of the best over that, at the same resolution
  double texture = 0.0;      ///< rms of the compared intensities
  int pairs = 0;             ///< of images that were compared
  bool informative = false;  ///< what passes on the road fixes the baseline
};

/// Searches for the length of the baselines, in camera heights, with which what moves on the road
/// is carried from image to image. Each image is seen from above on the plane that touches the road
/// under the camera along its travel, without what stands still in the picture and without what
/// points along the road; a baseline then is a shift, and all pairs are correlated as one. Where a
/// coder repeats the asphalt, its dashes, cracks and shadows still pass: a few bright pixels that
/// dense flow loses and that move together (time slices through image sequences: Bolles, Baker,
/// Marimont, "Epipolar-Plane Image Analysis", IJCV 1987).
/// @param images     of one camera, at least two; one a pose of the motion.
/// @param reference  index into the images.
/// @throws std::invalid_argument for sizes that disagree.
RoadSweepResult sweep_road(const PinholeCamera& camera, const std::vector<const GrayImage*>& images,
                           const MotionEstimate& motion, std::size_t reference,
                           const RoadSweepOptions& options);

}  // namespace camber
