#pragma once

#include "camber/vehicle/detail/vehicle_posterior.h"

namespace camber::internal {

/// Minimises the minus log posterior by Levenberg-Marquardt, with Marquardt's scaling of the
/// damping.
/// @param tolerance  a step that gains less ends it.
/// @return           minus log posterior at the refined state.
double refine(const VehiclePosterior& posterior, VehicleState* state, int max_iterations,
              double tolerance);

}  // namespace camber::internal
