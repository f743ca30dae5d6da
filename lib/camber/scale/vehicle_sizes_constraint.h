#pragma once

#include <vector>

#include "camber/road/constraint.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// The scale by the sizes of several vehicles together: each one's measurement of the plane under
/// it is, for a ground of known shape, one of the scale. One car's size is known to some 5 %, the
/// average of several to a few per cent (ScaleNoise). It is a check: the vehicles' own measurements
/// are fused one by one.
/// @param vehicles  constraints by single vehicles, linearised around `road`.
/// @return one measurement of the logarithm of the scale with its source and gate; empty where
///         fewer than three vehicles measure it.
Constraint vehicle_sizes_constraint(const RoadPosterior& road,
                                    const std::vector<Constraint>& vehicles,
                                    const ScaleNoise& noise);

}  // namespace camber
