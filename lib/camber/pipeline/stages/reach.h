#pragma once

#include "camber/motion/correspondences.h"
#include "camber/motion/motion.h"
#include "camber/pipeline/stages/load.h"

/// How far from the reference images are of use: the flow follows the road over a few camera
/// heights, and what it finds in images beyond is another layer. Both ranges reach outwards from
/// the reference up to the first image that falls short; all frames, where poses are given or fewer
/// than three would be left.
namespace camber::stages {

/// Of what the best image shares with the reference.
inline constexpr double kLeastShared = 0.25;

/// Images that share with the reference at least kLeastShared of what the best does.
FrameRange frames_that_share(const LoadedFrames& frames, const Correspondences& matches);

/// Images whose matches of what stands still agree with the motion (epipolar_agreement) nearly as
/// well as the best image's.
FrameRange frames_that_agree(const LoadedFrames& frames, const Correspondences& matches,
                             const MotionEstimate& motion, const MotionOptions& options);

/// The matches with the frames of a range that holds the reference.
Correspondences matches_within(const FrameRange& range, Correspondences matches);

}  // namespace camber::stages
