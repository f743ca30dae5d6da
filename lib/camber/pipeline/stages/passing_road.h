#pragma once

#include <optional>

#include "camber/motion/correspondences.h"
#include "camber/photometric/road_sweep.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"

namespace camber::stages {

/// The length of the baselines by what passes on the road; none where nothing shows it.
std::optional<RoadSweepResult> sweep_road(const LoadedFrames& frames, const MotionEstimate& motion,
                                          int num_threads);

/// Whether what passes shows another near road than the ego plane's.
bool shows_another(const RoadSweepResult& sweep, const EgoPlane& ego);

/// Whether the pictures repeat the road: a coder of film hardly sends smooth asphalt, which then
/// stands still and is matched as if it were far away.
bool repeats_road(const LoadedFrames& frames, const MotionEstimate& motion);

/// The ground by what passes on the road, a plane, in place of one by matches, of which those that
/// lie on it are taken.
Ground passing_ground(const LoadedFrames& frames, const Correspondences& matches,
                      const MotionEstimate& motion, const RoadSweepResult& sweep,
                      const GroundOptions& options);

}  // namespace camber::stages
