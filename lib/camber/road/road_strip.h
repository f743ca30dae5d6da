#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "camber/geometry/se3.h"

namespace camber {

struct RoadStripOptions {
  double cell = 0.5;             ///< m, along the driven line and across, > 0
  double half_width = 6.0;       ///< m to each side of the driven line, > 0
  double stretch = 100.0;        ///< m, of one file, > 0
  double beyond = 25.0;          ///< m beyond the last camera, >= 0
  double surface_sigma = 0.005;  ///< m, unevenness within a cell, > 0
  /// Windows that follow each other measure a cell with nearly the same error: the information of
  /// all observations is divided by this, >= 1.
  double correlation = 5.0;
  double freedom = 4.0;   ///< of Student's distribution of an observation, > 0
  void validate() const;  ///< throws std::invalid_argument
};

/// A place of the driven line: the foot of the camera on the road.
struct DrivenPoint {
  Eigen::Vector3d foot = Eigen::Vector3d::Zero();  ///< m, strip frame
  double s = 0.0;                                  ///< m in plan from the first one
};

/// The line along which the camera was driven, in plan.
class DrivenLine {
 public:
  DrivenLine() = default;
  /// @param feet  in the order of the drive, strip frame (z up); standing adds nothing.
  explicit DrivenLine(const std::vector<Eigen::Vector3d>& feet);

  struct Place {
    double s = 0.0;        ///< m in plan
    double lateral = 0.0;  ///< m, positive: left
    double height = 0.0;   ///< m, of the line there
  };
  /// The nearest place of the line between two of its lengths; the last piece goes on straight.
  std::optional<Place> project(const Eigen::Vector3d& point, double from_s, double to_s) const;
  /// The line at a length, extrapolated straight. @return position; *direction in plan, unit.
  Eigen::Vector3d at(double s, Eigen::Vector2d* direction = nullptr) const;
  double length() const { return points_.empty() ? 0.0 : points_.back().s; }
  const std::vector<DrivenPoint>& points() const { return points_; }
  /// Length of each foot that was given, in their order.
  const std::vector<double>& lengths() const { return lengths_; }
  /// Moves each point up. @param rise  m, one a point
  void raise(const std::vector<double>& rise);

 private:
  std::vector<DrivenPoint> points_;  // strictly ascending s
  std::vector<double> lengths_;
};

/// The road at one cell.
struct StripCell {
  double s = 0.0, lateral = 0.0;                    ///< m, of its middle
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< m, strip frame
  double sigma = 0.0;      ///< m, of the height, against the driven line near it
  std::uint8_t label = 0;  ///< 1 road, 2 pavement, 0 not known
  std::array<std::uint8_t, 3> color{0, 0, 0};
  int observations = 0;
};

/// The road along a driven line: what a drive keeps of it. Heights are along the strip's z.
struct RoadStrip {
  SE3 strip_from_world;  ///< turns up to z; m
  DrivenLine line;
  std::vector<StripCell> cells;  ///< by s, then lateral
};

/// The driven line at the height of the cells beside it, a parabola along and a cross slope through
/// those within 1.5 m: a camera shakes by centimetres, and the foot of each with it. Where there
/// are no cells it goes on as it was from where there are.
DrivenLine laid_onto(const std::vector<StripCell>& cells, DrivenLine line);

/// Collects what windows see of the road and fuses it cell by cell, robustly.
class RoadStripBuilder {
 public:
  RoadStripBuilder(DrivenLine line, const RoadStripOptions& options);

  /// One observation. @param point strip frame, m. @param near_s  of the camera that sees it.
  void add(const Eigen::Vector3d& point, double sigma, std::uint8_t label,
           const std::array<std::uint8_t, 3>& color, double near_s);

  std::vector<StripCell> finish() const;

 private:
  struct Observation {
    float above = 0.0F, sigma = 0.0F;  // m, over the driven line
    std::uint8_t label = 0;
    std::array<std::uint8_t, 3> color{0, 0, 0};
  };
  DrivenLine line_;
  RoadStripOptions options_;
  std::map<std::pair<int, int>, std::vector<Observation>> cells_;
};

}  // namespace camber
