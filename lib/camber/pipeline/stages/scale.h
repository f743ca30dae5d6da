#pragma once

#include <vector>

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/focal_length_by_dashes.h"
#include "camber/scale/lane_marking_constraint.h"
#include "camber/scale/road_width_constraint.h"
#include "camber/scale/scale_noise.h"
#include "camber/scene/results.h"

namespace camber {

/// The road with its metres: the posterior given all sources that agree.
struct ScaledRoad {
  RoadPosterior road;
  bool metric = true;  ///< false: lengths are in nominal camera heights
  std::vector<ConstraintReport> reports;
  /// Sources that contradict each other or the result.
  std::vector<RunDocument::Warning> contradictions;
  /// Of the logarithm of the scale, by what sources differ; not in `road`, since vehicles would
  /// take the place of the sources that disagree.
  double contradiction_variance = 0.0;
  LaneMarkingConstraint markings;
  RoadWidthConstraint width;
  double scale_change = 0.0;  ///< of the logarithm of the scale, against the camera's height alone
  /// No strokes: none speak against the given one, or none were looked for. Not among the
  /// contradictions: the vehicles may contradict it, which assemble() compares.
  DashFocalLength dash_focal_length = {};
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
/// @throws NoAnswerError where a masked road is found at another layer: what is beside it would
/// obstruct the driven path.
ScaledRoad scale(const LoadedFrames& frames, const Correspondences& matches,
                 const PhotometricGround& ground, const ScaleOptions& options);

}  // namespace stages
}  // namespace camber
