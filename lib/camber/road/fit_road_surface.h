#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/progress.h"
#include "camber/core/status.h"
#include "camber/road/consistency_graph.h"
#include "camber/road/road_surface.h"

namespace camber {

struct RoadSurfaceOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;                ///< <= 0: see resolve_num_threads
  std::optional<Eigen::Vector3d> up;  ///< not given: the cloud's default_up()
  double max_slope = 0.6;             ///< rad from level that ground may have, (0, 1.4]
  /// m; > 0: one inlier threshold for all points. 0: from the points' own uncertainty or, without
  /// it, from the noise of the cloud.
  double inlier_threshold = 0.0;
  /// As in PlaneFitOptions.
  std::optional<Eigen::Vector3d> viewpoint;
  int min_patch_points = 20;  ///< patches on fewer points are dropped, >= 3
  /// How far the ground may bend away from a patch's plane before the patch ends: in standard
  /// deviations of a point, > 0, and at least this many metres, >= 0 (metric clouds only).
  double tolerance_sigmas = 0.7;
  double tolerance = 0.015;
  /// Foot points of the camera's path, in the cloud's true coordinates, in driving order: separates
  /// the road from other ground, and ahead from behind. May be empty.
  std::vector<Eigen::Vector3d> driven_line;
  /// Of a cloud without a driven line that is not in a camera's frame nothing separates road from
  /// other ground: its road and pavements are called ground. true: its largest smooth piece is the
  /// road.
  bool largest_is_road = false;
  ConsistencyOptions consistency;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct RoadSurfaceFit {
  /// kFailed: no patch; kWeak: the threshold is below the points' noise; see reason.
  Status status = Status::kNotRun;
  std::string reason;
  RoadSurface surface;      ///< in the cloud's true coordinates, origin included
  std::vector<int> labels;  ///< patch id of each point of the cloud, -1: none
  double noise = 0.0;       ///< m, typical standard deviation of a point across its patch
};

/// Models a road cloud by planar patches; the number of planes is not given. Patches end where the
/// ground bends or steps; those that are not road (pavements; roofs of cars) are patches of
/// another kind, walls are left out. See also RoadSurfaceOptions::largest_is_road. Same seed, same
/// answer, for any number of threads. Non-finite points are skipped.
/// @throws std::invalid_argument if options.validate() or the cloud's array lengths fail.
RoadSurfaceFit fit_road_surface(const RoadCloud& cloud, const RoadSurfaceOptions& options,
                                const Progress& progress = {});

}  // namespace camber
