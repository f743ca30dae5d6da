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
/// @param constraints  linearised at `road`; without measurements: reported only.
/// @param common_scale_sigma  standard deviation of an error of the logarithm of the scale that all
///                     constraints have in common, beside their own: as the common error
///                     "size_population" of the road (SharedEstimate).
FusedRoad fuse(const RoadPosterior& road, const std::vector<Constraint>& constraints,
               double common_scale_sigma = 0.0);

/// What the measurements change by with the logarithm of the scale, the road's shape held.
/// @param constraint  linearised at `road`.
Eigen::VectorXd by_whole_scale(const RoadPosterior& road, const Constraint& constraint);

/// What a constraint measures of the logarithm of the scale if the road's shape is right.
struct ImpliedLogScale {
  double mean = 0.0;  ///< change of the logarithm of the road's scale
  double variance = 0.0;
};

/// @param constraint  linearised at `road`.
/// @return nothing where it does not depend on the scale.
std::optional<ImpliedLogScale> implied_log_scale(const RoadPosterior& road,
                                                 const Constraint& constraint);

/// Share, by how far a source is off the others, of its squared difference that is added to the
/// scale's variance: none up to `start`, all of it at `gate`, linear between. All three are
/// standard deviations.
double contradiction_share(double sigmas, double start, double gate);

/// Constraints that know nothing of each other, as one; nothing measured gives an empty one.
Constraint stacked(const std::vector<const Constraint*>& parts);

}  // namespace camber
