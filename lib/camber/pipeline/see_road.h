#pragma once

#include "camber/pipeline/reconstruct.h"
#include "camber/pipeline/stage_runner.h"

namespace camber {

/// The road as matches alone show it.
struct SeenRoad {
  Correspondences matches;
  MotionEstimate motion;
  Ground ground;
};

/// The road from nothing: match, motion, a first ground, and see_road_again(). Where another near
/// road may be the right one, also from those that the plane search found; the one with the most
/// support is taken (stages::road_support).
/// @throws NoAnswerError as the stages do.
/// @param frames  those out of reach are taken out (stages/reach.h); what lies off the
///                road is taken off the masks of a network (fuse_masks.h).
SeenRoad see_road(const Scene& scene, LoadedFrames& frames, const ReconstructOptions& options,
                  const StageRunner& run);

/// Rounds of match, motion and ground: each matches again with the ground of the one before.
/// @param start  a first ground with the matches and the motion that it is of.
SeenRoad see_road_again(LoadedFrames& frames, SeenRoad start, const ReconstructOptions& options,
                        const StageRunner& run);

}  // namespace camber
