#pragma once

#include <Eigen/Core>

#include "camber/synth/road_model.h"

namespace camber {

/// A street as the things beside it are laid out: the road itself, or the street that it meets at
/// a junction. Stations and offsets (m in plan, positive to the left) are the street's own.
class Street {
 public:
  /// The road on which the camera begins.
  static Street main(const RoadModel& road) { return {road, false}; }
  /// The street of a junction (layout().junction must be there); its station 0 is on the road's
  /// axis, positive to the road's left.
  static Street crossing(const RoadModel& road) { return {road, true}; }

  const RoadModel& road() const { return *road_; }
  bool is_crossing() const { return crossing_; }
  double half_width() const;
  /// Whether the street is there at a station.
  bool exists(double station) const;
  Eigen::Vector2d place(double station, double offset) const;
  /// rad, counter-clockwise from the world's x.
  double heading(double station) const;
  Eigen::Vector3d point(double station, double offset) const;
  /// Height of the ground at a place in plan; `station` is a guess.
  double height_at(const Eigen::Vector2d& place, double station) const;
  /// Signed distance of a place from the carriageway of the road and the street together.
  double edge_distance(const Eigen::Vector2d& place, double station) const;

 private:
  Street(const RoadModel& road, bool crossing) : road_(&road), crossing_(crossing) {}
  const RoadModel* road_;
  bool crossing_;
};

}  // namespace camber
