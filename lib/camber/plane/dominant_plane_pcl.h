#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"

namespace camber {

struct DominantPlaneOptions {
  double inlier_threshold = 0.05;      ///< m, point to plane, > 0
  double max_tilt = 0.6;               ///< rad, of the normal against `up`, in (0, pi / 2)
  Eigen::Vector3d up{0.0, -1.0, 0.0};  ///< unit; the answer's normal is on its side
  int max_iterations = 1000;           ///< >= 1
  double probability = 0.9999;         ///< of a sample without outliers, in (0, 1)
  void validate() const;               ///< throws std::invalid_argument
};

struct DominantPlane {
  Status status = Status::kNotRun;  ///< kFailed: fewer than 3 points, or no plane
  std::string reason;
  Plane plane;               ///< least squares over the inliers
  std::vector<int> inliers;  ///< ascending indices into the input
};

/// The dominant plane of points as the paper finds it: random sample consensus (Fischler and
/// Bolles, CACM 1981), by the Point Cloud Library's SACSegmentation. One threshold, every point
/// alike; no covariance (fit_plane knows both). The same points give the same plane.
DominantPlane dominant_plane_pcl(const std::vector<Eigen::Vector3d>& points,
                                 const DominantPlaneOptions& options);

}  // namespace camber
