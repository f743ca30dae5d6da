#pragma once

#include <string>
#include <vector>

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/focal_length_by_dashes.h"
#include "camber/scale/lane_marking_constraint.h"
#include "camber/scale/road_width_constraint.h"
#include "camber/scale/scale_evidence.h"
#include "camber/scale/scale_noise.h"
#include "camber/scene/results.h"

namespace camber {

/// The road with its metres: the posterior given all sources that agree.
struct ScaledRoad {
  RoadPosterior road;
  bool metric = true;  ///< false: lengths are in nominal camera heights, see without_metres
  std::vector<ConstraintReport> reports;
  /// What each source and check knows of the scale, by itself; what decides is the judge.
  std::vector<ScaleEvidence> evidence;
  LaneMarkingConstraint markings;
  RoadWidthConstraint width;
  double scale_change = 0.0;  ///< of the logarithm of the scale, against the camera's height alone
  /// Derivative of the logarithm of the scale by that of the focal length: see CameraUncertainty.
  double scale_by_focal = 1.0;
  /// No strokes: none speak against the given one, or none were looked for. Not among the
  /// evidence: the vehicles may contradict it, which the judge compares.
  DashFocalLength dash_focal_length = {};
  /// Of one image: the scale is that of the camera's height, the paint's own size the least of it.
  bool by_ego_height = false;
  NearRoadSource near_road = NearRoadSource::kMatches;
  std::string without_metres = {};  ///< why it is not metric
};

namespace stages {

/// Standard deviation of the logarithm of the scale before any source: hardly anything is known.
inline constexpr double kOpenLogScale = 1.0;

struct ScaleOptions {
  bool use_markings = true;    ///< painted markings whose sizes the scene knows
  bool use_road_width = true;  ///< the road's nearly constant width, where a mask shows it
  /// Factor on the covariance of the ground field, >= 1: errors of the matches that whole stretches
  /// of road share (moving shadows, reflections). Measured by bench_main_job's heights.
  double ground_inflation = 4.0;
  ScaleNoise noise;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
};

/// Collects what every source measures of the road and its scale, and fuses those that agree.
/// @throws NoAnswerError where no match shows the road near the camera.
ScaledRoad scale(const LoadedFrames& frames, const Correspondences& matches,
                 const PhotometricGround& ground, const ScaleOptions& options);

}  // namespace stages
}  // namespace camber
