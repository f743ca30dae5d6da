#pragma once

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/pipeline/stage_runner.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/match.h"

namespace camber {

/// The road as matches alone show it, with the images that show it.
struct FoundRoad {
  LoadedFrames
      frames;  ///< those within reach of the reference (stages/reach.h); of a network's
               ///< mask of the reference what lies off the road is taken off (fuse_masks.h)
  Correspondences matches;
  MotionEstimate motion;
  Ground ground;
};

namespace stages {

struct FindRoadOptions {
  int rounds = 3;  ///< of matching again with the ground known, at most; >= 0
  MatchOptions match;
  MotionOptions motion;
  GroundOptions ground;
};

/// The road from nothing: match, motion, a first ground, and rounds of matching again with the
/// ground known. Where another near road may be the right one, also from those that the plane
/// search found; the one on which the most agrees is taken (road_agreement).
/// @throws NoAnswerError as the stages do.
FoundRoad find_road(const Scene& scene, LoadedFrames frames, const FindRoadOptions& options,
                    const StageRunner& run);
/// The same, neither timed nor reported.
FoundRoad find_road(const Scene& scene, LoadedFrames frames, const FindRoadOptions& options);

/// The rounds alone, from a first ground with the matches and the motion that it is of.
FoundRoad find_road_from(FoundRoad start, const FindRoadOptions& options, const StageRunner& run);

}  // namespace stages
}  // namespace camber
