#pragma once

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

/// Constraints that know nothing of each other, as one; nothing measured gives an empty one.
Constraint stacked(const std::vector<const Constraint*>& parts);

}  // namespace camber
