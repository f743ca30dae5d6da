#pragma once

// When an answer is weak: the same limits for patches, for the planes that vehicles stand on and
// for the scale.

#include <fmt/format.h>

#include <cmath>
#include <string>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber::stages::detail {

inline constexpr double kWeakHeight = 0.3;  // m, standard deviation of a plane's height
inline constexpr double kWeakScale = 0.05;  // relative standard deviation

struct Judgement {
  Status status = Status::kOk;
  std::string reason;
};

/// @param unobserved  why the ground is hardly seen; empty: it is.
inline Judgement patch_status(const UncertainPlane& plane, const std::string& unobserved) {
  if (!unobserved.empty()) {
    return {Status::kNotObservable, unobserved + "; carried by the road around it"};
  }
  const double sigma = std::sqrt(plane.covariance(2, 2));
  if (sigma > kWeakHeight) return {Status::kWeak, fmt::format("height known to {:.2f} m", sigma)};
  return {};
}

/// A vehicle on ground that is known that badly is weak, however well its keypoints agree: it
/// may be no vehicle, or none on that ground.
inline void state_ground(VehicleEstimate* vehicle) {
  if (vehicle->status != Status::kOk || !(vehicle->plane_sigma_height > kWeakHeight)) return;
  vehicle->status = Status::kWeak;
  vehicle->reason =
      fmt::format("the plane below it is known to {:.2f} m", vehicle->plane_sigma_height);
}

inline Judgement scale_status(double relative_sigma) {
  if (relative_sigma <= kWeakScale) return {};
  return {Status::kWeak, fmt::format("known to {:.1f} % only", 100.0 * relative_sigma)};
}

}  // namespace camber::stages::detail
