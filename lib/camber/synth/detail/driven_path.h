#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "camber/synth/road_model.h"
#include "camber/synth/scene_features.h"

namespace camber {

/// A place on a path in plan.
struct PathPose {
  Eigen::Vector2d place;
  double heading = 0.0;  ///< rad, counter-clockwise from the world's x
  double station = 0.0;  ///< of the road there
};

/// A path over the ground, by the distance driven in space (m).
class DrivenPath {
 public:
  virtual ~DrivenPath() = default;
  virtual PathPose at(double distance) const = 0;
};

/// Along the road at an offset from its centreline, from station 0. The slow drift sideways is not
/// counted in distances.
class LanePath : public DrivenPath {
 public:
  /// @param drift  m sideways a metre of station
  LanePath(const RoadModel& road, double offset, double drift)
      : road_(road), offset_(offset), drift_(drift) {}
  PathPose at(double distance) const override;

 private:
  const RoadModel& road_;
  double offset_, drift_;
};

/// From the road's right lane round a junction's corner into the street's right lane: straight, an
/// arc with 1.5 m of transition on either side, straight. Distance 0 is in the middle of the turn.
class CornerPath : public DrivenPath {
 public:
  /// @param road_offset, street_offset  of the lanes' middle from the axis to its right, m, > 0
  CornerPath(const RoadModel& road, const CornerOptions& corner, double road_offset,
             double street_offset);
  PathPose at(double distance) const override;
  /// Distance from the turn's beginning to its end.
  double turn_length() const { return turn_length_; }

 private:
  struct Node {
    Eigen::Vector2d place;
    double heading, distance;
  };
  const RoadModel& road_;
  std::vector<Node> nodes_;
  double turn_length_ = 0.0;
};

}  // namespace camber
