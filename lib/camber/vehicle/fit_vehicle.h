#pragma once

#include <cstdint>
#include <vector>

#include "camber/vehicle/shape_prior.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

struct VehicleFitOptions {
  std::uint64_t seed = 0;
  /// Standard deviation of a visible keypoint, as a share of the detection box's width (in u) and
  /// height (in v), > 0. Networks see the box resized to 64 x 64 cells.
  double keypoint_sigma = 1.0 / 64.0;
  /// Standard deviation of a box edge, as a share of the box's side, > 0; beside 1 px for all.
  double box_sigma = 0.025;
  int num_coefficients = 20;           ///< of the shape prior, >= 0; 0: mean shape, size alone free
  int num_yaws = 16;                   ///< headings tried at the start, >= 4
  double stance_sigma_height = 0.012;  ///< m, wheels against the plane: suspension, unevenness; > 0
  double stance_sigma_tilt = 0.006;    ///< rad, likewise; > 0
  /// The plane is never doubted, however much the keypoints contradict it (the flat-road baseline);
  /// otherwise a plainly wrong plane loses its weight.
  bool trust_plane = false;
  const VehiclePrior* prior = nullptr;  ///< not owned; nullptr: the shipped one
  /// 36: all keypoints; 14: wheels, lights, roof corners and windscreen corners only.
  int keypoint_set = 36;
  void validate() const;  ///< throws std::invalid_argument
};

/// Places one vehicle on its plane: from keypoints, with pose, size and shape free under their
/// priors; or, without keypoints, from its box, the plane and the size prior.
///
/// The estimate is the maximum of the posterior of (position, rotation, dimensions, shape): pixel
/// errors follow a mixture of seen, guessed and grossly wrong keypoints, so no viewpoint and no
/// outlier threshold is needed; the plane enters with its covariance. Confidences are used only
/// if they explain the residuals better than treating all keypoints alike.
/// Never fails on a usable box: where the answer cannot be trusted the status is kNotObservable and
/// a fallback is given. A box without area or with non-finite sides gives kFailed.
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
