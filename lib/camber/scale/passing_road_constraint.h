#pragma once

#include "camber/road/road_posterior.h"

namespace camber {

/// Of the logarithm of the camera's height in baselines by a sweep: the road bends and tilts
/// against the travel.
inline constexpr double kSweptHeight = 0.05;

/// The camera's height in baselines, the ego plane's offset over the scale, by what passes on the
/// road.
/// @param log_baseline  logarithm of the unit of length over that height: of a RoadSweepResult that
///                      is informative.
Constraint passing_road_constraint(const RoadPosterior& road, double log_baseline);

}  // namespace camber
