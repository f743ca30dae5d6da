#pragma once

#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// How well a plane that is handed in without a covariance is taken to be known.
struct SupportOptions {
  double given_sigma_height = 0.010;  ///< m, a local plane given with the detection; > 0
  double given_sigma_tilt = 0.004;    ///< rad; > 0
  double ego_sigma_height = 0.02;     ///< m, at the foot below the camera; > 0
  double ego_sigma_tilt = 0.03;       ///< rad: how much a road's slope changes on the way; > 0
  double level_sigma_height = 0.05;   ///< m, at the foot below the camera; > 0
  double level_sigma_tilt = 0.06;     ///< rad; > 0
  void validate() const;              ///< throws std::invalid_argument
};

/// A local plane given with a detection: known around the place where the box's bottom meets it
/// (or, if its ray misses the plane, at the foot below the camera). Source "given".
SupportPlane given_support(const PinholeCamera& camera, const VehicleDetection& detection,
                           const SupportOptions& options);

/// The plane under the camera taken for ground farther ahead too. Source "ego".
SupportPlane ego_support(const Plane& ego_plane, const SupportOptions& options);

/// A level plane `height` below the camera, wide. Source "level".
SupportPlane level_support(double height, const SupportOptions& options);

/// The same plane taken for certain, as the flat-road and coplanar baselines do: standard
/// deviations of a millimetre and a milliradian.
SupportPlane certain_support(const Plane& plane, const std::string& source);

}  // namespace camber
