#pragma once

#include <optional>

#include "camber/motion/correspondences.h"
#include "camber/photometric/road_sweep.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/scale/scale_evidence.h"

namespace camber::stages {

inline constexpr const char* kPassingRoad = "passing_road";  ///< name of its evidence
/// Of the logarithm of the camera's height in baselines by a sweep: the road bends and tilts
/// against the travel.
inline constexpr double kSweptHeight = 0.05;

/// By what passes on the road.
RoadSweepResult sweep_road(const LoadedFrames& frames, const MotionEstimate& motion,
                           int num_threads);

/// The ground by what passes on the road, in place of one by matches: a coder of film hardly sends
/// smooth asphalt, which then stands still and is matched as if it were far away.
/// @param found  by the matches; null: they show none.
/// @return none where that is as good, or nothing passes that shows one: where the pictures do not
///         repeat the road, only for want of another.
std::optional<Ground> passing_ground(const LoadedFrames& frames, const Correspondences& matches,
                                     const MotionEstimate& motion, const Ground* found,
                                     const GroundOptions& options);

/// The height of the camera in baselines by what passes, against the ego plane's.
/// @return none where nothing shows it, or where the ground is that of what passes.
std::optional<ScaleEvidence> passing_evidence(const LoadedFrames& frames,
                                              const PhotometricGround& refined, int num_threads);

}  // namespace camber::stages
