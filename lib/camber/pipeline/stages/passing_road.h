#pragma once

#include <optional>

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

/// The height of the camera in baselines by what passes, against the ego plane's: a coder of film
/// hardly sends smooth asphalt, which then stands still and is matched as if it were far away.
/// Only where the pictures repeat the road it can contradict the others.
/// @param always  false: none where the pictures do not repeat it.
/// @return none where nothing shows it.
std::optional<ScaleEvidence> passing_evidence(const LoadedFrames& frames,
                                              const PhotometricGround& refined, bool always,
                                              int num_threads);

}  // namespace camber::stages
