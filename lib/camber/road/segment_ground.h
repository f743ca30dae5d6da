#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/status.h"

namespace camber {

/// All that is decided from a cloud as a whole: given to its parts, each with the points around it,
/// their labels are those of the whole.
struct GroundPlan {
  bool from_air = false;         ///< seen evenly from everywhere, as airborne scans are
  double cell = 1.0;             ///< m, of the grid, a multiple of 1/64 m
  double largest_object = 12.0;  ///< m, shorter side in plan; at most 256 cells
  double slope = 0.2;            ///< rise over run
  double tolerance = 0.15;       ///< m, of ground points about the surface
  double foot_tolerance = 0.05;  ///< m, the same beside what rises steeply

  /// m along each axis of the grid (x and y where z is up), beyond which no other point changes a
  /// point's label: what openings, gaps that are filled, raised pieces and reflections below the
  /// ground reach, added up.
  double reach() const;
  /// m: clouds whose origins differ by multiples of this in plan (not in height), with the same
  /// coordinates where these are multiples of a power of two, get the same labels bit for bit.
  double alignment() const;
  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct GroundOptions {
  Eigen::Vector3d up{0.0, 0.0, 1.0};  ///< in the cloud's frame; need not be unit
  /// m, height of the zero of the cloud's true coordinates above the ground; NaN: unknown. Gives
  /// the ground in the blind circle under a sensor.
  double sensor_height = std::numeric_limits<double>::quiet_NaN();
  double cell = 0.0;  ///< m, of the grid; 0: 1 m, or by the spacing for clouds from the air
  /// m, shorter side in plan of what may stand on the ground; 0: 12, or 30 for clouds from the air
  double largest_object = 0.0;
  double slope = 0.0;  ///< rise over run within which the ground bends; 0: 0.2, from the air 0.35
  double tolerance = 0.0;          ///< m, of ground points about the surface; 0: by their scatter
  std::optional<GroundPlan> plan;  ///< in place of the four above and of what they leave open
  int num_threads = 0;             ///< <= 0: see resolve_num_threads

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
  double foot_tolerance = 0.0;  ///< m, that was used beside what rises steeply
  /// Of the cells that hold points, those that hold ground; in a wood or a town far from all.
  double ground_area_share = 0.0;

  /// What another part of the same survey is to be given.
  GroundPlan plan() const {
    return {from_air,      std::ceil(64.0 * cell) / 64.0, largest_object, slope, tolerance,
            foot_tolerance};
  }
};

/// Separates ground from what stands on it and from reflections below it, in single laser scans,
/// clouds of a camera and airborne scans; needs a metric cloud.
///
/// The lowest height in each cell of a grid that enough points support; cells below the plane
/// through those around them are dropped; what rises out of openings with growing squares is not
/// ground (Zhang et al., "A progressive morphological filter for removing nonground measurements
/// from airborne LIDAR data", TGRS 2003; Pingel, Clarke, McBride, "An improved simple morphological
/// filter", ISPRS 2013), nor are small pieces of what is left that stand above their surroundings.
/// Beyond the border of what was seen and in gaps the ground goes on as it does at large (a robust
/// plane through the lowest heights about), so that a slope at the border is no object. The surface
/// through the rest, refined with the points near it, takes the points within the tolerance; beside
/// steep objects, whose feet would count, only those closer to it.
///
/// Time and memory are linear in the points: the grid has at most about four cells a point, places
/// far off the bulk of the cloud are left out of it where it would grow larger, and are not ground.
/// With a plan nothing is left out, and the cells stay: clouds that are too wide for that fail.
/// @throws std::invalid_argument if options.validate() fails. The same for any number of threads.
GroundSegmentation segment_ground(const RoadCloud& cloud, const GroundOptions& options = {});

}  // namespace camber
