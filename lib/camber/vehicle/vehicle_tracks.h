#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/motion/correspondences.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/ground_message.h"

namespace camber {

/// The vehicles of one image among several, in the order of their detections.
struct TrackFrame {
  SE3 world_from_camera;  ///< m
  double time_s = 0.0;    ///< ascending over the frames
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;      ///< one a detection, camera frame of this image
  std::vector<VehicleEstimate> estimates;  ///< one a detection, from fit_vehicle
  /// Not owned; where two frames have theirs, the vehicles are registered between them.
  const GrayImage* image = nullptr;
  /// Of the image, one byte a pixel, row-major, non-zero: a vehicle. Of the view that leads a track
  /// only such pixels are registered in the other images. Not owned; null: not known.
  const std::vector<std::uint8_t>* vehicle_mask = nullptr;
  /// Standard deviations of world_from_camera against the other frames', beside a scale that all
  /// frames share.
  double pose_sigma_turn = 6e-5;    ///< rad
  double pose_sigma_shift = 0.001;  ///< m
};

/// Joint prior of the planes under all detections, which lie on one ground.
struct SharedGround {
  /// 3 rows a detection, frame by frame in the order of their detections (but see `rows`): (tilt
  /// about axis1, tilt about axis2, height at the centroid) of its support plane, rad and m, the
  /// blocks on the diagonal being the supports' own covariances; then one row for the logarithm of
  /// the factor on the cameras' baselines. Empty: planes have nothing in common.
  Eigen::MatrixXd covariance;
  /// First row of each detection's plane, [frame][detection]; -1: it has none, and a track with
  /// such a view takes no part in the message passing. Empty: every detection has its rows.
  std::vector<std::vector<Eigen::Index>> rows;
};

/// Track numbers of all detections, [frame][detection], from 0 in order of appearance.
///
/// Detections of neighbouring frames belong together if a box that the earlier vehicle would have
/// in the later image overlaps the later box: parked, driving along its heading (the faster, the
/// less the overlap counts, gates.speed), or as it is (vehicles that move with the camera);
/// greedily, best overlap first, at least gates.overlap; one missing frame is bridged. Detections
/// with a `track` are joined by it alone.
/// @throws std::invalid_argument if a frame's lists differ in length.
std::vector<std::vector<int>> find_tracks(const PinholeCamera& camera,
                                          const std::vector<TrackFrame>& frames,
                                          const AssociationGates& gates = {});

/// One detection of a vehicle.
struct TrackView {
  std::size_t frame = 0;      ///< index into the frames
  std::size_t detection = 0;  ///< index into that frame's detections
};

/// What a track measures of the ground under its lead detection and of the scale.
struct TrackMessage {
  int track = -1;                ///< as in TrackFit::tracks
  TrackView lead;                ///< the view that is known best
  std::vector<TrackView> views;  ///< that were solved together, the lead among them
  /// About the lead detection's support plane as it was handed in, without the priors of the planes
  /// under the track and of the scale; information 0: none (see `reason`).
  GroundMessage message;
  /// Distance from what the shared ground and the other tracks' messages leave open, in standard
  /// deviations (root of a squared Mahalanobis distance of up to 4 degrees of freedom).
  double mahalanobis = std::numeric_limits<double>::quiet_NaN();
  double weight = 0.0;    ///< robust, in [0, 1]; 0: no message
  bool accepted = false;  ///< weight at least 1/2
  std::string reason;     ///< why it is not accepted
};

struct TrackFit {
  /// [frame][detection]; that of fit_vehicle where there is one view only and no shared ground.
  std::vector<std::vector<VehicleEstimate>> estimates;
  /// [frame][detection]: number of the track, the given one where there is one, else a number that
  /// no given track has; -1: no given track and not found in another frame.
  std::vector<std::vector<int>> tracks;
  /// Of the final estimates, one a track that was solved and has its rows in the shared ground.
  std::vector<TrackMessage> messages;
};

/// Solves the vehicles that are seen in two frames or more again, with one size and shape for all
/// views of a track and a pose for each (after Murthy, Sharma, Madhava Krishna, "Shape Priors for
/// Real-Time Monocular Object Localization in Dynamic Environments", IROS 2017).
///
/// Both hypotheses are solved: parked (one pose in the world) and moving (along its heading, with a
/// speed that changes little); the one of greater evidence is accepted. What all views share
/// (priors, plane) counts once; what the shape coefficients leave of each keypoint is solved for as
/// well, the same in all views. Views that see the vehicle the other way round take the heading of
/// greater likelihood over all of them. Views without reliable keypoints keep their own answer.
/// With images the vehicle is registered in them (vehicle_registration.h), so that a parked vehicle
/// is triangulated by its own parallax.
///
/// With a shared ground, messages are passed between the vehicles: what each of them measures of
/// its plane and of the scale beside that plane's prior goes to the others as a normal
/// distribution, and each is solved again with what the others leave of its prior (expectation
/// propagation; Minka, UAI 2001). A message that contradicts the rest by far is down-weighted; a
/// vehicle whose ground is not observable sends none.
/// @param scale_sigma  relative standard deviation of the cameras' baselines; > 0, else
///                     std::invalid_argument.
/// @param ground       not owned; nullptr: every vehicle by itself.
/// @throws std::invalid_argument if the shared ground's covariance has another number of rows, or
///                               its rows are others than the detections', or a vehicle mask
///                               does not have the camera's number of pixels.
TrackFit fit_tracks(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                    const VehicleFitOptions& options, int num_threads = 0,
                    double scale_sigma = 0.01, const SharedGround* ground = nullptr);

}  // namespace camber
