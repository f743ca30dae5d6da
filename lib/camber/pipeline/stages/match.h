#pragma once

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"

namespace camber::stages {

struct MatchOptions {
  CorrespondenceOptions flow;  ///< grid and forward-backward check
  /// Variational refinement of the first flow where no mask bounds the road. Without: half its
  /// time.
  bool smooth_start = true;
  FlowCache* kept = nullptr;  ///< flows between frames that other windows use, too; by frame ids
};

/// Dense correspondences of the reference image with all others, nothing known of the scene.
Correspondences match(const LoadedFrames& frames, const MatchOptions& options);

/// Matches again: the ground and the motion found so far predict where each ground pixel is seen,
/// so that only small differences remain for the flow.
/// @param fine  in full resolution, in place of coarse and smooth to find the road.
Correspondences match_again(const LoadedFrames& frames, const Correspondences& before,
                            const MotionEstimate& motion, const Ground& ground, bool fine,
                            const MatchOptions& options);

/// How far the ground's points move in the other images where `after` predicts them in place of
/// `before`, px: 95 % of them at most by so much. 0 without points.
double prediction_change(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const GroundField& before,
                         const Ground& after);

}  // namespace camber::stages
