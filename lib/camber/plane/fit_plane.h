#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/status.h"
#include "camber/geometry/plane.h"

namespace camber {

struct PlaneFitOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;                      ///< <= 0: see resolve_num_threads
  Eigen::Vector3d up{0.0, 0.0, 1.0};        ///< the fitted normal is on this side; unit not needed
  double max_tilt = 0.7;                    ///< rad between the normal and up, (0, pi / 2]
  /// m; > 0: one inlier threshold for all points. 0: 2.5 standard deviations of each point if the
  /// cloud has sigmas or covariances, else of the noise estimated from the cloud.
  double inlier_threshold = 0.0;
  int max_hypotheses = 2000;                ///< > 0
  double confidence = 0.9999;               ///< of the adaptive stop, (0, 1)

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct PlaneFit {
  Status status = Status::kNotRun;  ///< reason says why, unless kOk
  std::string reason;
  UncertainPlane plane;             ///< frame of the input cloud, origin included
  std::vector<int> inliers;         ///< ascending indices into the input
  double rmse = std::numeric_limits<double>::quiet_NaN();       ///< m along the normal, inliers
  double condition = std::numeric_limits<double>::quiet_NaN();  ///< of the normal equations, >= 1
  int hypotheses = 0;               ///< minimal samples that were scored
};

/// Fits the dominant plane of a cloud with outliers, weighing each point by its own uncertainty
/// along the plane's normal. Non-finite points are skipped. Same seed, same answer, for any number
/// of threads. Status kFailed with fewer than 3 usable points or no plane within max_tilt.
/// @throws std::invalid_argument if options.validate() fails.
PlaneFit fit_plane(const RoadCloud& cloud, const PlaneFitOptions& options);

}  // namespace camber
