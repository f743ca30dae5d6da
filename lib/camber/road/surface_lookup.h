#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "camber/road/plan_polygon.h"
#include "camber/road/road_surface.h"

namespace camber {

/// m, between the heights of two patches over one place from which on they are different levels (a
/// bridge, the next turn of a ramp), unless their standard deviations explain it. Floors of car
/// parks, the closest levels that are driven on, are 2.5 m apart.
inline constexpr double kLevelGap = 2.0;

/// How a line lies to the ground of a surface.
struct LineOverGround {
  double offset = 0.0;  ///< m, the line above the ground, as most of it is
  /// m, each place above the ground of its level; between places without ground interpolated.
  std::vector<double> above;
};

/// A surface made ready for many queries. It refers to the surface, which must not change
/// meanwhile. Any number of threads may ask.
class SurfaceLookup {
 public:
  /// @param any_kind  patches of kind `other` answer, too, where neither road nor pavement of the
  /// same level is within reach
  explicit SurfaceLookup(const RoadSurface& surface, bool any_kind = false);

  /// As RoadSurface has them.
  SurfaceQuery query_ray(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                         double reach) const;
  SurfaceQuery query(const Eigen::Vector3d& place, double reach) const;

  /// The same of a place whose height is known to be the ground's: patches of other levels
  /// (kLevelGap) do not answer; reason "another level: 6.0 m above" where there are only such.
  /// Surfaces without a scale: as query().
  SurfaceQuery query_level(const Eigen::Vector3d& place, double reach) const;

  /// Where the ground is under a line, whose heights may have a constant offset (an antenna's), or
  /// be none at all (z = 0). The offset is that of the places near the ground, if a quarter as many
  /// are as have any other offset in common, else the commonest. From the places that have it on
  /// the ground is followed both ways, as far as the difference between line and ground does not
  /// jump by kLevelGap. @param line  places in order, about a metre apart
  LineOverGround follow(const std::vector<Eigen::Vector3d>& line, double reach) const;

 private:
  struct Entry {
    const PlanePatch* patch;
    PlanPolygon outline;
    Eigen::AlignedBox2d box;
  };
  struct Candidate {
    const PlanePatch* patch;
    double distance;  ///< m in plan, 0: inside
    double above;     ///< m, the place above the patch
    double sigma;     ///< m, of its height
  };
  std::vector<Candidate> within(const Eigen::Vector3d& place, double reach) const;
  double gap(const Candidate& candidate) const;
  SurfaceQuery choose(const std::vector<Candidate>& candidates, const Eigen::Vector3d& place,
                      bool of_level) const;

  Eigen::Vector3d up_;
  GroundAxes axes_;
  bool metric_;
  std::vector<Entry> entries_;
};

/// Makes road of the patches of kind `other` that a line lies on where neither road nor pavement of
/// its level is within reach: who gives a line on them means them.
/// @return  their ids, ascending
std::vector<int> take_as_road(const std::vector<Eigen::Vector3d>& line, double reach,
                              RoadSurface* surface);

}  // namespace camber
