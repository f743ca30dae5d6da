#pragma once

// Equation 9 of the paper as a Ceres problem.

#include <ceres/ceres.h>

#include <memory>
#include <utility>
#include <vector>

#include "camber/vehicle/paper/cost_functions/vehicle_blocks.h"
#include "camber/vehicle/paper/joint_fit.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::paper::internal {

/// One vehicle's parameter blocks.
struct VehicleBlocks {
  std::size_t index = 0;  ///< of the detection
  SE3 pose;
  Eigen::VectorXd form;   ///< length, width, height, coefficients
  Eigen::Vector4d plane;  ///< the paper's convention
};

class JointProblem {
 public:
  JointProblem(const PinholeCamera& camera, const std::vector<SupportPlane>& supports,
               const std::vector<VehicleStart>& starts, const JointFitOptions& options);

  const std::vector<VehicleBlocks>& blocks() const { return blocks_; }
  int num_links() const { return num_links_; }

  void solve(JointFit* out);

  /// Covariance of one vehicle: (translation, rotation vector in the vehicle's frame, form), and
  /// the variance of its plane's height at its bottom centre, m^2.
  struct Covariance {
    Eigen::MatrixXd vehicle;
    double plane_height = 0.0;
  };
  /// One a vehicle; empty where the problem is singular.
  std::vector<Covariance> covariances();

 private:
  void add_vehicle(VehicleBlocks& b, const VehicleStart& start, const SupportPlane& support);
  void add_ground_terms(VehicleBlocks& b, const ShapePrior& shape);
  void add_links();
  void hold(bool poses, bool forms);
  ceres::Solver::Options solver_options() const;

  const PinholeCamera& camera_;
  const JointFitOptions& options_;
  const VehiclePrior& prior_;
  ceres::HuberLoss huber_;
  PoseManifold pose_manifold_;
  PlaneManifold plane_manifold_;
  std::vector<VehicleBlocks> blocks_;
  int num_links_ = 0;
  std::unique_ptr<ceres::Problem> problem_;
};

}  // namespace camber::paper::internal
