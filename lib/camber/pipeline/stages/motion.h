#pragma once

#include <cstdint>
#include <vector>

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/pipeline/stages/load.h"

namespace camber::stages {

/// Marks the poses of all frames as contradicted, with the reason, where far fewer matches with an
/// image agree with the given motion than with the one that they ask for by themselves
/// (epipolar_agreement).
void check_poses(const Correspondences& matches, const MotionOptions& options,
                 LoadedFrames* frames);

/// Of contradicted poses whether they are of other moments, by the small turns from frame to frame:
/// those of a vehicle on its springs are the same in the images and in poses of the same moments,
/// whatever the axes of the poses, and straight on, too. Poses that are smoothed or have no turns
/// of their own are left as they are.
/// @param motion  of the images, by their matches.
void check_turns(const Scene& scene, const MotionEstimate& motion, LoadedFrames* frames);

/// Motion of the camera over the frames: from their poses where all of them are known (then metric,
/// see MotionEstimate::metres_per_baseline), else from correspondences of points that stand still.
/// @throws NoAnswerError for a stationary camera, a pure rotation, too little texture.
MotionEstimate motion(const LoadedFrames& frames, const Correspondences& matches,
                      const MotionOptions& options);

/// Bundle adjustment with better correspondences; known poses stay, and so does the start where the
/// adjustment fails.
MotionEstimate motion_again(const LoadedFrames& frames, const Correspondences& matches,
                            const MotionEstimate& start, const MotionOptions& options);

/// One entry a grid point: 0 on or beside a vehicle or detection of the reference image.
std::vector<std::uint8_t> static_points(const LoadedFrames& frames, const Correspondences& matches);

}  // namespace camber::stages
