#pragma once

#include <optional>
#include <vector>

#include "camber/road/road_posterior.h"

namespace camber {

/// How far the camera went from one frame to the next, by its speed.
struct TravelledDistance {
  double metres = 0.0;  ///< >= 0
  double sigma = 0.0;   ///< m, > 0
};

/// The length of the path over the frames by the speed against its length in baselines.
/// @param distances    of the stretches between neighbouring frames whose speed is known.
/// @param baselines    length of the same stretches, baselines.
/// @param correlation  of the errors of two stretches, in [0, 1].
/// @param path_sigma   relative, of the length in baselines.
/// @return nothing where the speed does not show a motion beyond three standard deviations.
std::optional<Constraint> speed_constraint(const RoadPosterior& road,
                                           const std::vector<TravelledDistance>& distances,
                                           const std::vector<double>& baselines, double correlation,
                                           double path_sigma);

}  // namespace camber
