#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/road/road_surface.h"

namespace camber {

struct ProfileOptions {
  double step = 1.0;     ///< m between stations, along the line in plan, > 0
  double length = 10.0;  ///< m of road over which grade and vertical radius are measured, > 0
  double reach = 0.5;    ///< m that a station may lie beyond a patch's boundary, >= 0
  /// What no cloud shows of itself, of its frame: rad, how well its up is known, >= 0, about the
  /// middle of the line, and m, how far its heights drift along the road, >= 0 (surfaces without a
  /// scale: not used). The defaults are what good inertial navigation leaves.
  double levelling_sigma = 1.7453292519943296e-4;  // 0.01 deg
  double drift_sigma = 0.011;
  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The road at one station. NaN where it is not known.
struct ProfilePoint {
  double station = 0.0;             ///< m along the line, in plan
  Status status = Status::kNotRun;  ///< kFailed: not covered; nothing but the place is given then
  std::string reason;
  int patch = -1;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();           ///< on the road, frame of the surface
  double height = std::numeric_limits<double>::quiet_NaN();  ///< m along up
  double grade = std::numeric_limits<double>::quiet_NaN();   ///< rise over run along the line
  double cross_slope = std::numeric_limits<double>::quiet_NaN();  ///< the same across, left side up
  /// m, of the vertical curve: positive in a sag, negative on a crest, infinite where straight.
  double vertical_radius = std::numeric_limits<double>::quiet_NaN();
  /// 1/m, of the vertical curve: 1 / vertical_radius.
  double vertical_curvature = std::numeric_limits<double>::quiet_NaN();
  double sigma_height = std::numeric_limits<double>::quiet_NaN();              ///< m
  double sigma_grade = std::numeric_limits<double>::quiet_NaN();               ///< rise over run
  double sigma_cross_slope = std::numeric_limits<double>::quiet_NaN();         ///< rise over run
  double sigma_vertical_curvature = std::numeric_limits<double>::quiet_NaN();  ///< 1/m
};

/// Height, grade and cross slope of a surface along a polyline, from its first point to its last.
/// Heights and cross slopes are those of the patch at the station; the grade is the least-squares
/// slope of the heights over `length` of road around it, and the vertical radius that of the
/// parabola through them, both given only where most of that length is covered. These heights are
/// taken every tenth of `length` or closer, whatever the step. A surface of planes bends only where
/// they meet: as much of the bend around as PlanePatch::unmodelled_sigma allows is taken to be in
/// them. The heights of the line's points only choose between levels (a bridge and
/// the road under it), as SurfaceLookup::follow() has it: a constant offset of the line does not
/// matter, and where there is but another level the reason is "another level: 6.0 m above".
/// Standard deviations hold the planes' covariances, what the planes leave out
/// (PlanePatch::unmodelled_sigma), drift and levelling; along the road the middle two are processes
/// with the covariance sigma^2 exp(-distance / length).
/// @throws std::invalid_argument for a line of fewer than two places, for one of more than a
/// million stations or heights, or if options.validate() fails.
std::vector<ProfilePoint> road_profile(const RoadSurface& surface,
                                       const std::vector<Eigen::Vector3d>& line,
                                       const ProfileOptions& options);

}  // namespace camber
