#pragma once

#include <optional>
#include <vector>

#include "camber/road/constraint.h"
#include "camber/road/road_posterior.h"

namespace camber {

/// A road with all sources that agree, and what became of each, in their order.
struct FusedRoad {
  RoadPosterior road;
  std::vector<ConstraintReport> reports;
};

/// Conditions a road on all sources at once. Each is compared with what the road and the other
/// sources let expect; while one is beyond its gate, the one that is farthest beyond is rejected
/// and the rest compared again.
/// @param constraints  linearised around `road`; without measurements: reported only.
FusedRoad fuse(const RoadPosterior& road, const std::vector<Constraint>& constraints);

/// What a constraint measures of the logarithm of the scale if the road's shape is right.
struct ImpliedLogScale {
  double mean = 0.0;  ///< change of the logarithm of the road's scale
  double variance = 0.0;
};

/// @param constraint  linearised around `road`.
/// @return nothing where it does not depend on the scale.
std::optional<ImpliedLogScale> implied_log_scale(const RoadPosterior& road,
                                                 const Constraint& constraint);

/// Constraints that know nothing of each other, as one; nothing measured gives an empty one.
Constraint stacked(const std::vector<const Constraint*>& parts);

}  // namespace camber
