#pragma once

#include <optional>

#include "camber/geometry/plane.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// The ground under a vehicle after the joint solution of vehicle and plane: the plane on which its
/// wheels stand, camera frame, with the vehicle's covariance and the stance's spread. axis1 points
/// to the vehicle's front.
/// @return nothing where the vehicle says nothing of its own: no keypoints or a bad fit.
std::optional<UncertainPlane> standing_plane(const VehicleEstimate& vehicle,
                                             const VehicleFitOptions& options);

}  // namespace camber
