#pragma once

#include <cstdint>

#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

struct VehicleFitOptions {
  std::uint64_t seed = 0;
  double keypoint_sigma = 1.0 / 64.0;  ///< share of the box's larger side, > 0; visible keypoints
  void validate() const;               ///< throws std::invalid_argument
};

/// Places one vehicle on its plane from keypoints (mean shape of its class, scaled by the size
/// prior; pose only) or, without keypoints, from its box, the plane and the size prior.
/// Never fails on a usable box: where the answer cannot be trusted the status is kNotObservable and
/// a fallback is given. @throws std::invalid_argument for a wrong number of keypoints.
VehicleEstimate fit_vehicle(const PinholeCamera& camera, const VehicleDetection& detection,
                            const SupportPlane& support, const VehicleFitOptions& options);

}  // namespace camber
