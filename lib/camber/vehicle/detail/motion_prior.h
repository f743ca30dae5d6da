#pragma once

// How a vehicle moves from view to view: not at all, or along its heading with a speed that changes
// little. A random walk on the steps between the views.

#include "camber/vehicle/detail/vehicle_state.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber::internal {

/// d log(exp(v) exp(w)) / dw at w = 0: the inverse of the right Jacobian of rotations. |v| < pi.
Eigen::Matrix3d logarithm_jacobian(const Eigen::Vector3d& v);

/// Shift (m) and rotation vector from one view to the next, in the vehicle's frame at the first.
using Step = Eigen::Matrix<double, 6, 1>;
/// By the pose in the first view, that in the second, the log scale of the cameras' baselines.
using StepJacobian = Eigen::Matrix<double, 6, 13>;

Step step_between(const ViewCamera& first, const ViewCamera& second, const ViewPose& a,
                  const ViewPose& b, double log_scale, StepJacobian* jacobian);

class MotionPrior {
 public:
  MotionPrior(std::vector<ViewCamera> cameras, const MotionNoise& noise);

  /// Adds its minus log density (up to log_normaliser), optionally with its normal equations.
  double add(const VehicleState& state, const ParameterLayout& layout,
             NormalEquations* equations) const;
  /// Sum of the logarithms of the standard deviations.
  double log_normaliser(const VehicleState& state) const;

  const ViewCamera& camera(int view) const { return cameras_[static_cast<std::size_t>(view)]; }

 private:
  double interval(int view) const;
  /// Of the step from view k to k + 1; of its first component, for a moving vehicle after the first
  /// step, that of the change against the step before.
  Step sigma(const VehicleState& state, int view) const;

  std::vector<ViewCamera> cameras_;
  MotionNoise noise_;
};

}  // namespace camber::internal
