#pragma once

#include <string>
#include <vector>

#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/paper/start_on_plane.h"
#include "camber/vehicle/paper/terms.h"

namespace camber::paper {

/// What ties the planes of neighbouring vehicles together.
enum class PlaneLinks {
  kNone,
  kConsistency,  ///< L_c, equation 8: equal normals and offsets
  kContinuity    ///< equal heights midway between the footprints
};

/// Which unknowns are solved for at a time.
enum class Schedule {
  kTogether,    ///< all at once
  kAlternating  ///< pose and planes with the form held, then the form, in turns (equation 2)
};

enum class LinearSolver {
  kCholesky,           ///< sparse, exact
  kConjugateGradients  ///< on the normal equations, with the Jacobi preconditioner of the paper
};

struct JointFitOptions {
  Terms terms = Terms::kMeant;
  Weights weights;
  int num_coefficients = 5;  ///< of the shape prior: 0, 5, 10, 15 or 20
  PlaneLinks links = PlaneLinks::kConsistency;
  double link_reach = 7.0;    ///< m, between bottom centres whose planes are linked (paper: 5 to 7)
  bool planes_fixed = false;  ///< the ground planes are no unknowns (the baselines)
  Schedule schedule = Schedule::kTogether;
  int rounds = 4;  ///< of the alternating schedule, >= 1
  LinearSolver solver = LinearSolver::kCholesky;
  bool analytic = true;  ///< derivatives of the reprojection; false: automatic
  int max_iterations = 40;
  double function_tolerance = 1e-5;  ///< relative change of the cost at which the solver stops
  bool with_covariance = true;       ///< false: none is stated
  KeypointSet keypoint_set = KeypointSet::kAll36;
  const VehiclePrior* prior = nullptr;  ///< not owned; nullptr: the shipped one
  void validate() const;                ///< throws std::invalid_argument
};

struct JointFit {
  std::vector<VehicleEstimate> vehicles;  ///< one a detection
  std::vector<Plane> planes;              ///< under each, camera frame
  int solved = 0;                         ///< vehicles that entered the problem
  int links = 0;                          ///< pairs of planes
  int iterations = 0;
  double initial_cost = 0.0, final_cost = 0.0;
  bool converged = false;
  std::string message;  ///< of the solver
};

/// The paper's joint problem, equation 9: pose, form and ground plane of all vehicles of a frame
/// (Ceres, Levenberg-Marquardt, Huber on every term),
///   L = L_r + L_g + L_n + L_d + L_b + L_c + L_reg
/// (the print lacks the plus before L_reg). Vehicles without usable keypoints keep their start. One
/// thread; the same input gives the same bits.
/// @param supports, starts  one a detection; the supports' covariances weigh the planes' part of
///                          L_reg.
/// @throws std::invalid_argument for lists of different lengths or bad options.
JointFit fit_joint(const PinholeCamera& camera, const std::vector<SupportPlane>& supports,
                   const std::vector<VehicleStart>& starts, const JointFitOptions& options);

/// Starts and joint problem together.
JointFit fit_frame(const PinholeCamera& camera, const std::vector<VehicleDetection>& detections,
                   const std::vector<SupportPlane>& supports, const JointFitOptions& options);

}  // namespace camber::paper
