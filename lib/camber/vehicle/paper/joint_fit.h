#pragma once

#include <string>
#include <vector>

#include "camber/vehicle/fit_vehicle.h"

namespace camber::paper {

/// What ties the planes of neighbouring vehicles together.
enum class PlaneLinks {
  kNone,
  kConsistency,  ///< equation 8 of the paper: equal normals and offsets
  kContinuity    ///< equal heights midway between the footprints
};

struct JointFitOptions {
  int num_coefficients = 5;  ///< of the shape prior, in [0, 20]
  /// Equations 5, 7 and 9 as the paper prints them (see ground_contact.h, normal_disambiguation.h,
  /// base_point.h); false: mended, so that points are drawn to the ground and up differs from down.
  bool as_printed = false;
  /// Hand-set weights for all terms, in pixels, metres and radians; false: every term by its
  /// standard deviation, the plane by its covariance.
  bool fixed_weights = false;
  PlaneLinks links = PlaneLinks::kContinuity;
  double link_reach = 20.0;  ///< m, between vehicles whose planes are linked, > 0
  /// Pose and planes with the form held, then the form with the poses held, in turns (equation 2 of
  /// the paper); false: all at once.
  bool alternating = false;
  int rounds = 4;          ///< of the alternating schedule, >= 1
  bool iterative = false;  ///< conjugate gradients with Ceres's Jacobi preconditioner, not Cholesky
  /// Reprojection by analytic derivatives; false: automatic (only for 0, 5, 10, 15 and 20
  /// coefficients).
  bool analytic = true;
  double huber = 2.0;  ///< standard deviations, of every term, > 0
  int max_iterations = 30;
  bool with_covariance = true;  ///< false: that of the starts is kept
  KeypointSet keypoint_set = KeypointSet::kAll36;
  const VehiclePrior* prior = nullptr;  ///< not owned; nullptr: the shipped one

  /// The paper's problem: equations as printed, hand-set weights, global consistency, conjugate
  /// gradients with a Jacobi preconditioner.
  static JointFitOptions paper();
  void validate() const;  ///< throws std::invalid_argument
};

struct JointFit {
  std::vector<VehicleEstimate> vehicles;  ///< one a detection
  std::vector<Plane> planes;              ///< under each, camera frame
  int solved = 0;                         ///< vehicles that entered the problem
  int iterations = 0;
  double initial_cost = 0.0, final_cost = 0.0;
  bool converged = false;
  std::string message;  ///< of the solver
};

/// All vehicles of a frame and their planes in one problem (Ceres, Levenberg-Marquardt, Huber on
/// every term), from the starts that fit_vehicle gives. Vehicles whose start has no trusted
/// keypoints keep it. One thread; the same input gives the same bits.
/// @param supports, starts  one a detection.
/// @throws std::invalid_argument for lists of different lengths or bad options.
JointFit fit_joint(const PinholeCamera& camera, const std::vector<VehicleDetection>& detections,
                   const std::vector<SupportPlane>& supports,
                   const std::vector<VehicleEstimate>& starts, const JointFitOptions& options);

}  // namespace camber::paper
