#pragma once

#include <string>

#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/lane_marking_detection.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// What painted markings of known size measure of a road.
struct LaneMarkingConstraint {
  Constraint constraint;  ///< "lane_markings"; empty: nothing is measured, see reason
  std::string reason;
  bool contradicts = false;  ///< markings were found, and the ground lets expect other sizes
  int dashes = 0;            ///< strokes that take part
  int rows = 0;              ///< of the image, in which these strokes are seen
  int crossings = 0;         ///< pedestrian crossings that take part
  double farthest = 0.0;     ///< m, of what takes part
  /// Mean square of what the lengths miss the road by, in standard deviations, before and after.
  double misfit_before = 0.0, misfit_after = 0.0;
};

/// Joins strokes to broken lines, from the nearest on: the next stroke lies a period ahead (or a
/// whole number of them, where those between are hidden), within three standard deviations of where
/// the road, with the strokes before, puts it. Lengths between strokes' middles, of near strokes
/// and across crossings are then measurements of the ground.
LaneMarkingConstraint lane_marking_constraint(const RoadPosterior& road,
                                              const PinholeCamera& camera,
                                              const LaneMarkings& markings,
                                              const LaneMarkingSizes& sizes,
                                              const ScaleNoise& noise = {});

}  // namespace camber
