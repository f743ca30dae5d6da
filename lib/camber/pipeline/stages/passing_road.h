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

/// The logarithm of the baseline's length over the camera's height by the given speed and the given
/// height; none where one of them is not known, or the speed shows no motion.
std::optional<double> log_baseline_by_speed(const LoadedFrames& frames,
                                            const MotionEstimate& motion);

/// Whether a baseline of so many camera heights (its logarithm, known as well as by what passes)
/// shows another near road than the ego plane's.
bool shows_another(double log_baseline, const EgoPlane& ego);

/// Whether the pictures repeat the road: a coder of film hardly sends smooth asphalt, which then
/// stands still and is matched as if it were far away.
bool repeats_road(const LoadedFrames& frames, const MotionEstimate& motion);

/// The ground that is a plane so far under the camera, in place of one by matches, of which those
/// that lie on it are taken.
/// @param log_baseline  logarithm of the baseline's length over the camera's height.
/// @param by            not kMatches.
Ground plane_ground(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, double log_baseline, NearRoadSource by,
                    const GroundOptions& options);

/// The same by what passes on the road, or by the speed, where these show another near road than
/// the matches: what two of the three agree on, else the speed, which is no picture.
/// @param found     by the matches; null: they show none.
/// @param sweep     none: nothing shows what passes.
/// @param by_speed  whether the speed counts without a sweep.
std::optional<Ground> another_ground(const LoadedFrames& frames, const Correspondences& matches,
                                     const MotionEstimate& motion, const Ground* found,
                                     const std::optional<RoadSweepResult>& sweep, bool by_speed,
                                     const GroundOptions& options);

}  // namespace camber::stages
