#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/status.h"

namespace camber {

struct GroundOptions {
  Eigen::Vector3d up{0.0, 0.0, 1.0};  ///< in the cloud's frame; need not be unit
  /// m, height of the zero of the cloud's true coordinates above the ground; NaN: unknown. Gives
  /// the ground in the blind circle under a sensor.
  double sensor_height = std::numeric_limits<double>::quiet_NaN();
  double cell = 0.0;  ///< m, of the grid; 0: 1 m, or by the spacing for clouds from the air
  /// m, shorter side in plan of what may stand on the ground; 0: 12, or 30 for clouds from the air
  double largest_object = 0.0;
  double slope = 0.0;  ///< rise over run within which the ground bends; 0: 0.2, from the air 0.35
  double tolerance = 0.0;  ///< m, of ground points about the surface; 0: by their scatter
  int num_threads = 0;     ///< <= 0: see resolve_num_threads

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Which points of a cloud are ground.
struct GroundSegmentation {
  Status status = Status::kNotRun;  ///< kOk, or kFailed with a reason
  std::string reason;
  std::vector<int> labels;      ///< one a point: 1 ground, 0 not (or not finite)
  std::size_t ground = 0;       ///< points with label 1
  bool from_air = false;        ///< seen evenly from everywhere, as airborne scans are
  double cell = 0.0;            ///< m, that was used
  double largest_object = 0.0;  ///< m, that was used
  double slope = 0.0;           ///< that was used
  double tolerance = 0.0;       ///< m, that was used (from the air: on level ground)
};

/// Separates ground from what stands on it and from reflections below it, in single laser scans,
/// clouds of a camera and airborne scans; needs a metric cloud.
///
/// The lowest height in each cell of a grid that enough points support; cells below the plane
/// through those around them are dropped; what rises out of openings with growing squares is not
/// ground (Zhang et al., "A progressive morphological filter for removing nonground measurements
/// from airborne LIDAR data", TGRS 2003; Pingel, Clarke, McBride, "An improved simple morphological
/// filter", ISPRS 2013), nor are small pieces of what is left that stand above their surroundings.
/// The surface through the rest, refined with the points near it, takes the points within the
/// tolerance; beside steep objects, whose feet would count, only those closer to it.
///
/// Time and memory are linear in the points: the grid has at most about four cells a point, places
/// far off the bulk of the cloud are left out of it where it would grow larger, and are not ground.
/// @throws std::invalid_argument if options.validate() fails. The same for any number of threads.
GroundSegmentation segment_ground(const RoadCloud& cloud, const GroundOptions& options = {});

}  // namespace camber
