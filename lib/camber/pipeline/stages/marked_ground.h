#pragma once

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/scale/marked_road.h"

namespace camber {

/// The ground of one image by its markings of known size, m: in place of matches and motion.
struct MarkedGround {
  /// The markings' pixels; no other image is matched.
  Correspondences pixels;
  /// The shape's parameters take the motion's place: the field's shared errors, with their
  /// covariance in `motion.covariance`.
  PhotometricGround ground;
  MarkedRoad road;
};

namespace stages {

/// Finds the road by the markings of the only image.
/// @throws NoAnswerError, with what is missing.
MarkedGround marked_ground(const LoadedFrames& frames, const ScaleOptions& options);

/// The posterior of that road, with the camera's height where it is known. The two know nothing of
/// each other: they are compared before they are joined, and where they contradict each other the
/// given height stands and the scale's spread holds both.
ScaledRoad scale_by_markings(const LoadedFrames& frames, const MarkedGround& ground,
                             const ScaleOptions& options);

}  // namespace stages
}  // namespace camber
