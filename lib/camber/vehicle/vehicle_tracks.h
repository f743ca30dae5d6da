#pragma once

#include <vector>

#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber {

/// The vehicles of one image among several, in the order of their detections.
struct TrackFrame {
  SE3 world_from_camera;  ///< m
  double time_s = 0.0;    ///< ascending over the frames
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;      ///< one a detection, camera frame of this image
  std::vector<VehicleEstimate> estimates;  ///< one a detection, from fit_vehicle
  /// Not owned; where two frames have theirs, the vehicles' grey values are registered.
  const GrayImage* image = nullptr;
  /// Standard deviations of world_from_camera against the other frames', beside a scale that all
  /// frames share.
  double pose_sigma_turn = 6e-5;    ///< rad
  double pose_sigma_shift = 0.001;  ///< m
};

/// How the errors of the planes under all detections hang together: one ground gave them.
struct SharedGround {
  /// 3 rows a detection, frame by frame in the order of their detections: (tilt about axis1, tilt
  /// about axis2, height at the centroid) of its support plane, rad and m, the blocks on the
  /// diagonal being the supports' own covariances; then one row for the logarithm of the way's
  /// scale. Empty: planes have nothing in common.
  Eigen::MatrixXd covariance;
};

/// Track numbers of all detections, [frame][detection], from 0 in order of appearance.
///
/// Detections of neighbouring frames belong together if the box that the earlier vehicle, standing
/// still, would have in the later image overlaps the later box, or the boxes overlap as they are
/// (vehicles that move with the camera); greedily, best overlap first, at least 0.3; one missing
/// frame is bridged. Detections with a `track` are joined by it alone.
/// @throws std::invalid_argument if a frame's lists differ in length.
std::vector<std::vector<int>> find_tracks(const PinholeCamera& camera,
                                          const std::vector<TrackFrame>& frames);

/// Solves the vehicles that are seen in two frames or more again, with one size and shape for all
/// views of a track and a pose for each (after Murthy, Sharma, Madhava Krishna, "Shape Priors for
/// Real-Time Monocular Object Localization in Dynamic Environments", IROS 2017).
///
/// Both hypotheses are solved: parked (one pose in the world) and moving (along its heading, with a
/// speed that changes little); the one of greater evidence is kept. What all views share (priors,
/// plane) counts once; what the shape coefficients leave of each keypoint is solved for as well, the
/// same in all views. Views that see the vehicle the other way round say what they think of both
/// headings. Views without trusted keypoints keep their own answer. With
/// images the vehicle's grey values are registered (vehicle_registration.h), so that a parked
/// vehicle is triangulated by its own parallax.
///
/// With a shared ground the vehicles tell each other where it lies: what each of them says of its
/// plane and of the scale beside that plane's prior goes to the others as a normal distribution,
/// and each is solved again with what the others left of its prior (expectation propagation; Minka,
/// UAI 2001). A vehicle that contradicts the rest by far has less of a say; one whose ground is not
/// observable listens only.
/// @param scale_sigma  relative standard deviation of the way between the cameras; > 0, else
///                     std::invalid_argument.
/// @param ground       not owned; nullptr: every vehicle by itself.
/// @return one a detection of each frame; that of fit_vehicle where there is one view only and no
///         shared ground.
/// @throws std::invalid_argument if the shared ground's covariance has another number of rows.
std::vector<std::vector<VehicleEstimate>> fit_tracks(const PinholeCamera& camera,
                                                     const std::vector<TrackFrame>& frames,
                                                     const VehicleFitOptions& options,
                                                     int num_threads = 0, double scale_sigma = 0.01,
                                                     const SharedGround* ground = nullptr);

}  // namespace camber
