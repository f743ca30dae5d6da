#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/motion/match_noise.h"

namespace camber {

struct MotionOptions {
  std::uint64_t seed = 0;
  int max_essential_points = 6000;  ///< for the robust essential matrix, >= 50
  int max_bundle_points = 3000;     ///< for the bundle adjustment, >= 50
  double inlier_px = 1.0;           ///< epipolar and reprojection threshold, > 0
  double stationary_px = 0.35;  ///< median image motion below which the camera stands still, > 0
  double parallax_px = 0.35;    ///< parallax (90th percentile) below which it only turns, > 0
  MatchNoise noise;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument
};

/// Motion of one camera over a few images, up to scale: the longest baseline from the reference
/// has length 1.
struct MotionEstimate {
  Status status = Status::kNotRun;  ///< kFailed: see reason (stationary, no parallax, ...)
  std::string reason;
  std::vector<SE3> frame_from_reference;  ///< one an image, identity for the reference
  /// Covariance of (rotation vector applied on the left, rad; translation, baselines) of every
  /// image but the reference, in order; 6 (n - 1) square. The longest baseline's length is exact.
  Eigen::MatrixXd covariance;
  double pixel_sigma = 0.0;   ///< px, robust standard deviation of a match's coordinate
  int points = 0;             ///< static points in the bundle adjustment
  double inlier_ratio = 0.0;  ///< share of the sampled matches that obey the motion
  /// Length of the longest baseline, m, where the poses were given; none: up to scale.
  std::optional<double> metres_per_baseline;
  double baseline_sigma = 0.0;  ///< relative standard deviation of that length
};

/// How well given poses are taken to be known, against each other.
struct KnownPoseOptions {
  double rotation_sigma = 1e-4;      ///< rad, > 0
  double translation_sigma = 0.003;  ///< m, > 0
  double pixel_sigma = 0.2;          ///< px, of a match's coordinate, > 0
  double shortest_baseline = 0.02;   ///< m, below which the camera stands, > 0
};

/// The motion of a camera whose poses are given, in metres.
/// @param frame_from_reference  one an image, the identity for the reference.
/// @return kFailed where no two poses are shortest_baseline apart.
MotionEstimate motion_from_known_poses(const std::vector<SE3>& frame_from_reference,
                                       std::size_t reference, const KnownPoseOptions& options);

/// An image's pose from the reference camera, m.
inline SE3 metric_pose(const MotionEstimate& motion, std::size_t image,
                       double metres_per_baseline) {
  const SE3& pose = motion.frame_from_reference[image];
  return {pose.rotation(), pose.translation() * metres_per_baseline};
}

/// Direction of travel at the reference image, unit, its camera frame, forward (z > 0): derivative
/// of the parabola through the neighbouring positions, or the baseline to the only neighbour; of a
/// single image the optical axis. Positions nearer than a tenth of the longest baseline, of a
/// camera that stands, are passed over.
Eigen::Vector3d travel_direction(const MotionEstimate& motion, std::size_t reference);

/// Estimates the motion from dense correspondences of static points: a robust essential matrix
/// (MAGSAC) for the image with the widest motion, the others by resection on the points
/// triangulated so far (paper, section III-B), then bundle adjustments of all images in inverse
/// depth with a Cauchy loss, each of the points that agree with the one before, until it stays.
/// @param usable  one entry a grid point; 0 where the point may belong to something that moves.
/// @throws std::invalid_argument for sizes that disagree.
MotionEstimate estimate_motion(const PinholeCamera& camera, const Correspondences& matches,
                               const std::vector<std::uint8_t>& usable,
                               const MotionOptions& options);

/// Share of the matches of usable points that lie within `px` of the motion's epipolar lines, over
/// all images; 0 without a match. @throws std::invalid_argument for sizes that disagree.
double epipolar_agreement(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<std::uint8_t>& usable, const MotionEstimate& motion,
                          double px);

/// The same for the matches with one image. @param other  index into matches.matches.
double epipolar_agreement(const PinholeCamera& camera, const Correspondences& matches,
                          const std::vector<std::uint8_t>& usable, const MotionEstimate& motion,
                          double px, std::size_t other);

/// Bundle adjustment alone, from a motion that is nearly right: for better correspondences.
MotionEstimate refine_motion(const PinholeCamera& camera, const Correspondences& matches,
                             const std::vector<std::uint8_t>& usable, const MotionEstimate& start,
                             const MotionOptions& options);

}  // namespace camber
