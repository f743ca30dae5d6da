#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/export/plan_frame.h"
#include "camber/export/smooth_line.h"
#include "camber/road/road_surface.h"

namespace camber {

/// The ground at a place, in the plan frame.
struct GroundSample {
  double height = std::numeric_limits<double>::quiet_NaN();  ///< m; NaN: not known
  double sigma = std::numeric_limits<double>::quiet_NaN();   ///< m, standard deviation
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();         ///< unit, up
};

/// m, ground farther above or below a place belongs to another level.
inline constexpr double kPointLevelGap = 1.5;

/// Heights of the ground over the plan. Any number of threads may ask.
class HeightSource {
 public:
  virtual ~HeightSource() = default;
  /// @param place  m, plan frame; its z chooses between levels above one another.
  virtual GroundSample at(const Eigen::Vector3d& place) const = 0;
  /// Heights of the ground over one another at a place, ascending; empty: not known.
  virtual std::vector<double> levels(const Eigen::Vector2d& /*place*/) const { return {}; }
  /// Heights that lead at() along the ground under a line whose own are not the ground's; empty:
  /// the line's own do. @param line  places in order, about a metre apart, m, plan frame
  virtual std::vector<double> levels_along(const std::vector<Eigen::Vector3d>& line) const;
  /// m between heights that the data resolve along the ground; 0: not known.
  virtual double resolution() const = 0;
};

/// The patches of a surface, as SurfaceLookup::query_level() answers; levels_along() follows the
/// ground under lines that have other heights.
/// @param reach  m that a place may lie beyond a patch's boundary
std::unique_ptr<HeightSource> surface_heights(const RoadSurface& surface, const PlanFrame& frame,
                                              double reach);

/// The part of the plan where answers are wanted: what lies within `reach` of these places.
struct PlanCorridor {
  std::vector<Eigen::Vector2d> places;  ///< m, plan frame
  double reach = 0.0;                   ///< m, > 0
};

/// The surroundings of a line.
PlanCorridor corridor_along(const SmoothLine& line, double reach);

/// A plane through the points near a place, weighted by distance and robustly (Tukey's biweight).
/// Points with a label "ground" of 0 or "patch" of -1 are left out. Sparse parts take points from
/// farther. Nothing is answered where they are fewer than 4, to one side, or leave it uncertain.
/// @param where  points elsewhere are left out, also of the resolution; nullptr: all count
std::unique_ptr<HeightSource> cloud_heights(const RoadCloud& cloud, const PlanFrame& frame,
                                            const PlanCorridor* where = nullptr);

/// Colours of a cloud seen from above.
class ColorSource {
 public:
  /// @param where  as of cloud_heights()
  ColorSource(const RoadCloud& cloud, const PlanFrame& frame, const PlanCorridor* where = nullptr);
  ~ColorSource();
  /// Of the nearest point within three times the cloud's spacing; none: not seen.
  std::optional<std::array<std::uint8_t, 3>> at(const Eigen::Vector3d& place) const;
  double resolution() const;

 private:
  struct Points;
  std::unique_ptr<Points> points_;
};

}  // namespace camber
