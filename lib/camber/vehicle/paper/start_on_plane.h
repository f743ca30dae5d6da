#pragma once

#include <vector>

#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/paper/terms.h"

namespace camber::paper {

/// A keypoint of a detection with its weight.
struct WeighedKeypoint {
  int index = 0;                       ///< of the 36
  Eigen::Vector2d pixel{0.0, 0.0};     ///< px
  Eigen::Vector2d sigma_px{1.0, 1.0};  ///< px, u and v
  bool seen = false;                   ///< not hidden, not of low confidence
};

struct StartOptions {
  Weights weights;
  KeypointSet keypoint_set = KeypointSet::kAll36;
  int num_headings = 16;                ///< tried, in [4, 360]
  const VehiclePrior* prior = nullptr;  ///< not owned; nullptr: the shipped one
  void validate() const;                ///< throws std::invalid_argument
};

/// Where the paper's problem starts for one vehicle. Made of the box, the keypoints, the plane and
/// the mean vehicle; nothing of Camber's own estimator enters.
struct VehicleStart {
  /// The mean vehicle upright on its plane where its box is seen, with the heading under which the
  /// keypoints agree best; kWeak without keypoints (heading unknown), kFailed for a box without
  /// area.
  VehicleEstimate vehicle;
  std::vector<WeighedKeypoint> keypoints;  ///< empty: it does not enter the joint problem
};

/// @param supports  one a detection.
std::vector<VehicleStart> starts_on_planes(const PinholeCamera& camera,
                                           const std::vector<VehicleDetection>& detections,
                                           const std::vector<SupportPlane>& supports,
                                           const StartOptions& options);

}  // namespace camber::paper
