#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"

namespace camber {

/// Why a point was not triangulated, in the order in which the reasons are tested.
enum class DropReason {
  kNoMatch,               ///< no image passes the round-trip check
  kNearFocusOfExpansion,  ///< depth unknown: it moves along no parallax
  kBehindCamera,          ///< negative or infinite depth
  kInconsistent,          ///< the images contradict each other or the motion
};
inline constexpr std::size_t kNumDropReasons = 4;
std::string to_string(DropReason reason);  ///< "no_match", "near_focus_of_expansion", ...

struct TriangulationOptions {
  double max_relative_sigma = 0.5;  ///< of the depth, > 0; larger: kNearFocusOfExpansion
  double max_residual = 3.5;        ///< standard deviations of a reprojection residual, > 0
  MatchNoise noise;
  bool with_pose_jacobian = true;  ///< false: leaves pose_jacobian empty, which is faster
  int num_threads = 0;             ///< <= 0: see resolve_num_threads
  void validate() const;           ///< throws std::invalid_argument
};

/// Points on the reference image's viewing rays: x = ray / inverse_depth.
struct TriangulatedPoints {
  std::vector<int> grid;              ///< index of the grid point in the correspondences
  std::vector<Eigen::Vector3d> rays;  ///< z = 1, reference camera frame
  std::vector<double> inverse_depth;  ///< 1 / unit of the motion
  /// Standard deviation of inverse_depth from the noise of the point's own matches.
  std::vector<double> sigma_own;
  /// d(inverse depth) / d(pose), one row a point, columns as in MotionEstimate::covariance: the
  /// errors that all points share.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> pose_jacobian;
  std::array<long, kNumDropReasons> dropped{};

  std::size_t size() const { return grid.size(); }
  Eigen::Vector3d point(std::size_t i) const { return rays[i] / inverse_depth[i]; }
  /// Standard deviation of inverse_depth[i] with the motion's share.
  double sigma_total(std::size_t i, const Eigen::MatrixXd& pose_covariance) const;
  /// Those whose grid point is wanted. @param wanted one entry a grid point of the correspondences.
  TriangulatedPoints chosen(const std::vector<std::uint8_t>& wanted) const;
};

/// Triangulates grid points from all images with the given motion: least squares over the inverse
/// depth, weighted by the noise that each match's texture lets expect along its epipolar line.
/// @param wanted one entry a grid point; 0: leave it out, not counted as dropped.
TriangulatedPoints triangulate(const PinholeCamera& camera, const Correspondences& matches,
                               const MotionEstimate& motion,
                               const std::vector<std::uint8_t>& wanted,
                               const TriangulationOptions& options);

}  // namespace camber
