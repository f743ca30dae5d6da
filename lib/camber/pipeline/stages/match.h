#pragma once

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"

namespace camber::stages {

struct MatchOptions {
  CorrespondenceOptions flow;  ///< grid and forward-backward check
};

/// Dense correspondences of the reference image with all others, nothing known of the scene.
Correspondences match(const LoadedFrames& frames, const MatchOptions& options);

/// Matches again: the ground and the motion found so far predict where each ground pixel is seen,
/// so that only small differences remain for the flow.
/// @param last  whether no better prediction follows: then in full resolution.
Correspondences match_again(const LoadedFrames& frames, const Correspondences& before,
                            const MotionEstimate& motion, const Ground& ground, bool last,
                            const MatchOptions& options);

}  // namespace camber::stages
