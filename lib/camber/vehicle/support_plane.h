#pragma once

#include "camber/vehicle/vehicle_estimate.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber {

/// A local plane given with a detection: known around the place where the box's bottom meets it
/// (or, if its ray misses the plane, at the foot below the camera). Source "given".
SupportPlane given_support(const PinholeCamera& camera, const VehicleDetection& detection,
                           const SupportOptions& options);

/// The plane under the camera taken for ground farther ahead too. Source "ego".
SupportPlane ego_support(const Plane& ego_plane, const SupportOptions& options);

/// A level plane `height` below the camera, wide. Source "level".
SupportPlane level_support(double height, const SupportOptions& options);

/// Standard deviation of a plane that is taken for certain: m and rad.
inline constexpr double kCertainSigma = 1e-3;

/// The same plane taken for certain, as the flat-road and coplanar baselines do.
SupportPlane certain_support(const Plane& plane, const std::string& source);

}  // namespace camber
