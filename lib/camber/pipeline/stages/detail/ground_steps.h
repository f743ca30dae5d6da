#pragma once

// Steps that the ground stage and its photometric refinement share.

#include "camber/pipeline/stages/ground.h"

namespace camber::stages::detail {

/// Road points that carry the ego plane, up to scale.
struct ProfilePoints {
  RoadPoints road;
  double correlation = 1.0;  // see EgoPlaneOptions
};

/// The triangulated ones, thinned: neighbours share their errors.
ProfilePoints matched_profile(const GroundPoints& seen);

EgoPlane fit_ego(const LoadedFrames& frames, const MotionEstimate& motion, ProfilePoints points,
                 const GroundOptions& options);

/// @throws NoAnswerError for fewer points than a plane has parameters: no field follows from them.
void require_found(const GroundObservations& observed);

/// @throws NoAnswerError where no road point carries the ego plane: it is the plane search's alone.
void require_seen(const EgoPlane& ego);

/// Takes an ego plane and its scale, unless it failed. @return whether it was taken.
bool set_ego(const MotionEstimate& motion, EgoPlane ego, Ground* ground);

/// The ego plane of a plane search's hypothesis.
EgoPlane ego_of(const LoadedFrames& frames, const MotionEstimate& motion,
                const RoadHypothesis& hypothesis, const GroundOptions& options);

/// Leaves observations that are far off the near road of a hypothesis nearly without weight: many
/// matches that agree on another layer, such as what a wet road mirrors, would outweigh it.
void down_weight_off(const LoadedFrames& frames, const MotionEstimate& motion,
                     const RoadHypothesis& hypothesis, GroundObservations* observed);

/// Adds the near road of a hypothesis as observations of the ground.
void add_hypothesis(const LoadedFrames& frames, const MotionEstimate& motion,
                    const RoadHypothesis& hypothesis, GroundObservations* observed);

/// The ground that is a hypothesis' near road, with those matches that lie on it.
/// @param relative_sigma  of the hypothesis' camera height.
Ground ground_of(const LoadedFrames& frames, const Correspondences& matches,
                 const MotionEstimate& motion, const RoadHypothesis& hypothesis,
                 double relative_sigma, const GroundOptions& options);

GroundObservations ground_observations(const Correspondences& matches,
                                       const TriangulatedPoints& points);

}  // namespace camber::stages::detail
