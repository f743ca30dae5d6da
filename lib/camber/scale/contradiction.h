#pragma once

#include <optional>

#include "camber/road/constraint.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// A scale by a source that contradicts the others'.
struct ContradictingScale {
  double log_scale = 0.0;  ///< of the source over that of the others
  double variance = 0.0;   ///< that the difference adds to the logarithm of the result's scale
};

/// @param prior       the road before any source, its scale open.
/// @param constraint  of the source, linearised around `prior`.
/// @param report      what became of it among all sources.
/// @param others      change of the logarithm of the scale from `prior` to the road by the other
///                    accepted sources: the result lies near the source where that is the surest.
/// @return nothing where the source agrees, or alone knows the scale too badly to contradict one
///         (ScaleNoise::contradicting_scale): what it contradicts is the road's shape.
std::optional<ContradictingScale> contradicting_scale(const RoadPosterior& prior,
                                                      const Constraint& constraint,
                                                      const ConstraintReport& report, double others,
                                                      const ScaleNoise& noise);

}  // namespace camber
