#pragma once

#include <vector>

#include "camber/vehicle/shape_prior.h"
#include "camber/vehicle/vehicle_estimate.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber {

/// Which of the 36 keypoints are used.
enum class KeypointSet {
  kSmall14 = 14,  ///< wheels, lights, roof corners and windscreen corners
  kAll36 = 36
};

struct VehicleFitOptions {
  VehicleNoise noise;
  int num_coefficients = 20;  ///< of the shape prior, in [0, 20]; 0: mean shape, size alone free
  int num_yaws = 16;          ///< headings tried at the start, in [4, 360]
  /// The plane is never down-weighted, however much the keypoints contradict it (the flat-road
  /// baseline); otherwise a plainly wrong plane loses its weight.
  bool plane_is_exact = false;
  const VehiclePrior* prior = nullptr;  ///< not owned; nullptr: the shipped one
  KeypointSet keypoint_set = KeypointSet::kAll36;
  void validate() const;  ///< throws std::invalid_argument
};

/// Places one vehicle on its plane: from keypoints, with pose, size and shape free under their
/// priors; or, without keypoints, from its box, the plane and the size prior.
///
/// The estimate is the maximum of the posterior of (position, rotation, dimensions) with the shape
/// integrated out: pixel errors follow a mixture of seen, guessed and grossly wrong keypoints, so
/// no viewpoint and no outlier threshold is needed; the plane enters with its covariance.
/// Confidences are used only if they explain the residuals better than treating all keypoints
/// alike. Deterministic: the same input gives the same bits. Never fails on a usable box: where the
/// answer cannot be trusted the status is kNotObservable and a fallback is given. A box without
/// area or with non-finite sides gives kFailed.
/// @throws std::invalid_argument for a wrong number of keypoints or bad options.
VehicleEstimate fit_vehicle(const PinholeCamera& camera, const VehicleDetection& detection,
                            const SupportPlane& support, const VehicleFitOptions& options);

/// fit_vehicle for all vehicles of a frame, on up to `num_threads` threads.
/// @param supports one a detection.
std::vector<VehicleEstimate> fit_vehicles(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const std::vector<SupportPlane>& supports,
                                          const VehicleFitOptions& options, int num_threads = 0);

}  // namespace camber
