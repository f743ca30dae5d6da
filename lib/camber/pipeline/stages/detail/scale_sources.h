#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/pipeline/stages/scale.h"
#include "camber/scale/lane_marking_detection.h"
#include "camber/scale/speed_constraint.h"

namespace camber::stages::detail {

/// The road before any source of its metres.
RoadPosterior prior_road(const PhotometricGround& ground, double metres_per_baseline,
                         const ScaleOptions& options);

/// How far the camera went by the speed, and the same stretches of its motion.
struct TravelledPath {
  TravelledDistance distance;
  double baselines = 0.0;  ///< length, > 0
  int stretches = 0;       ///< between neighbouring frames
};

/// @return none without a speed, or where it does not show a motion.
std::optional<TravelledPath> travelled_path(const LoadedFrames& frames,
                                            const MotionEstimate& motion);

/// The path over the frames by the speed, where the scene has it.
std::optional<Constraint> measure_speed(const RoadPosterior& road, const LoadedFrames& frames,
                                        const MotionEstimate& motion, const ScaleNoise& noise);

/// The length of the path over the given positions, of poses that the matches contradict.
std::optional<Constraint> measure_positions(const RoadPosterior& road, const LoadedFrames& frames,
                                            const MotionEstimate& motion, const ScaleNoise& noise);

/// What gives a run its metres before the road's own features are looked at.
std::vector<Constraint> anchors(const RoadPosterior& road, const LoadedFrames& frames,
                                const MotionEstimate& motion, const ScaleNoise& noise);

/// The ground in the reference image, with where it is clear of vehicles.
GroundRaster ground_raster(const LoadedFrames& frames, const Correspondences& matches,
                           const Ground& ground, const RoadPosterior& road, int num_threads);

/// Markings, and the road at which their lengths are linearised.
struct FoundMarkings {
  LaneMarkingConstraint markings;
  RoadPosterior linearised_at;
};

/// @param given  whether the road's metres were given. Where they are wrong, far strokes fit a road
///               that bends for them, while those near the camera fit none: a scale at which more
///               of them fit is measured in its place.
FoundMarkings find_markings(const LoadedFrames& frames, const GroundRaster& raster,
                            const Eigen::Vector3d& travel, const PhotometricGround& ground,
                            const RoadPosterior& anchored, bool given, const ScaleOptions& options);

RoadWidthConstraint measure_width(const LoadedFrames& frames, const GroundRaster& raster,
                                  const Eigen::Vector3d& travel, const RoadPosterior& road,
                                  const ScaleOptions& options);

}  // namespace camber::stages::detail
