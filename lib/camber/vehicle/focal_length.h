#pragma once

#include <optional>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber {

/// What the proportions of vehicles know of the focal length.
struct FocalLengthEvidence {
  int vehicles = 0;     ///< that were compared, at that factor
  double factor = 1.0;  ///< on the focal length, of those tried the likeliest
  /// Log likelihood ratio of all vehicles, that factor over 1, >= 0; no vehicle adds more than
  /// HypothesisGates::focal_length_most.
  double gain = 0.0;
  /// Log likelihood ratio of the other source's factor over 1; 0 without one, and where no
  /// vehicle is near enough.
  double log_ratio_of_other = 0.0;
};

/// A wrong focal length stretches all that is reconstructed along the optical axis, the ground
/// included: a vehicle seen obliquely is then too long for its width, its height and the places of
/// its wheels. Each vehicle is fitted again with other focal lengths, on its plane stretched
/// likewise, so that every pixel of the ground stays where it is.
/// @param supports   planes under the detections, camera frame, m.
/// @param estimates  of the detections on these planes by fit_vehicle; those without a
///                   keypoint_cost are left out, and with a factor those that are farther than
///                   HypothesisGates::focal_length_farthest with both focal lengths.
/// @param other_factor  a factor that another source fits, tried beside the others; > 0.
/// The same for any number of threads.
FocalLengthEvidence focal_length_evidence(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const std::vector<SupportPlane>& supports,
                                          const std::vector<VehicleEstimate>& estimates,
                                          const VehicleFitOptions& options, int num_threads = 0,
                                          std::optional<double> other_factor = {});

/// One vehicle fitted with several focal lengths, its plane stretched likewise.
struct FocalLengthProfile {
  /// VehicleEstimate::keypoint_cost with each; NaN where few keypoints agree with any pose.
  std::vector<double> costs;
  /// m, of the camera above a plane through the vehicle's bottom that is parallel to the support,
  /// and its standard deviation with each. NaN where there is no answer.
  std::vector<double> heights, height_sigmas;
  std::vector<double> depths;  ///< m, of the vehicle's centre
};

/// @param factors  on the camera's focal length, > 0.
FocalLengthProfile focal_length_profile(const PinholeCamera& camera,
                                        const VehicleDetection& detection,
                                        const SupportPlane& support,
                                        const std::vector<double>& factors,
                                        const VehicleFitOptions& options);

}  // namespace camber
