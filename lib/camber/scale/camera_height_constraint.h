#pragma once

#include "camber/road/road_posterior.h"

namespace camber {

/// The camera's height above the road under it, which is the ego plane's offset: what gives a
/// single camera its metres.
/// @param height  m, along the road's normal, > 0.
/// @param sigma   m, of mounting and suspension, > 0.
Constraint camera_height_constraint(const RoadPosterior& road, double height, double sigma);

}  // namespace camber
