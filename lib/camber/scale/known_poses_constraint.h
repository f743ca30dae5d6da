#pragma once

#include "camber/road/road_posterior.h"

namespace camber {

/// The length of the baseline between cameras whose poses are given.
/// @param metres_per_baseline  of the longest baseline, > 0.
/// @param relative_sigma       of that length, > 0.
Constraint known_poses_constraint(const RoadPosterior& road, double metres_per_baseline,
                                  double relative_sigma);

}  // namespace camber
