#pragma once

#include <Eigen/Core>
#include <limits>

#include "camber/cloud/road_cloud.h"

namespace camber {

struct NormalOptions {
  int neighbors = 20;   ///< points of a plane fit, the point itself included, >= 3
  float radius = 0.0f;  ///< m; > 0: of them only those so near; needs a metric cloud
  /// Normals point to this place, m in the cloud's frame (origin included); if not finite, they
  /// point to the side of `up`.
  Eigen::Vector3d viewpoint = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  Eigen::Vector3d up{0.0, 0.0, 1.0};  ///< need not be unit
  int num_threads = 0;                ///< <= 0: see resolve_num_threads

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Fits a plane to each point's nearest neighbours (the direction of least variance) and puts its
/// unit normal into cloud.normals; NaN where there is none: points that are not finite, fewer than
/// three neighbours, all on one line (spread across it less than 1/300 of that along it).
/// @throws std::invalid_argument if options.validate() fails.
/// Same answer for any num_threads.
/// Hoppe et al., "Surface reconstruction from unorganized points", SIGGRAPH 1992.
void estimate_normals(RoadCloud& cloud, const NormalOptions& options = {});

}  // namespace camber
