#pragma once

#include <optional>

#include "camber/road/road_posterior.h"

namespace camber {

/// How far the camera went by its speed, over one or several stretches between frames.
struct TravelledDistance {
  double metres = 0.0;  ///< >= 0
  double sigma = 0.0;   ///< m, > 0
  double common = 0.0;  ///< m, the part of it that all windows of a drive share
};

/// Whether a distance shows a motion, beyond three standard deviations.
bool shows_motion(const TravelledDistance& distance);

/// The length of the path over the frames by the speed against its length in baselines.
/// @param distance    over all stretches between neighbouring frames whose speed is known.
/// @param baselines   length of the same stretches together, baselines.
/// @param stretches   how many there are.
/// @param path_sigma  relative, of the length in baselines.
/// @return nothing where the speed does not show a motion.
std::optional<Constraint> speed_constraint(const RoadPosterior& road,
                                           const TravelledDistance& distance, double baselines,
                                           int stretches, double path_sigma);

}  // namespace camber
