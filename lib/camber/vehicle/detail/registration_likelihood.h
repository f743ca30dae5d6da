#pragma once

// Likelihood of a vehicle's poses in several views by its registration between their images.

#include <optional>
#include <vector>

#include "camber/vehicle/detail/vehicle_registration.h"
#include "camber/vehicle/detail/vehicle_state.h"

namespace camber::internal {

/// One registration against the lead view.
struct RegisteredView {
  int view = 0;
  VehicleShift shift;
};

class RegistrationLikelihood {
 public:
  RegistrationLikelihood() = default;
  /// @param lead_pose, form  the vehicle in the lead view as its template was cut.
  /// @param registered       by one template.
  RegistrationLikelihood(const PinholeCamera& camera, const RegistrationNoise& noise, int lead,
                         const ViewPose& lead_pose, const Form& form,
                         const std::vector<RegisteredView>& registered);

  int count() const { return static_cast<int>(links_.size()); }

  /// Adds its minus log density, optionally with its normal equations. The errors that all
  /// registrations have in common (the lead image's own, the depth of the body) are solved for at
  /// every state and eliminated.
  /// @return nothing if a registered place is not in front of a camera.
  std::optional<double> add(const VehicleState& state, const ParameterLayout& layout,
                            NormalEquations* equations) const;

  /// Predicted less measured (displacement in px, log depth ratio) of registration i.
  /// By the lead's pose, the other view's, the size.
  using Jacobian = Eigen::Matrix<double, 3, 15>;
  std::optional<Eigen::Vector3d> residual(const VehicleState& state, int i,
                                          Jacobian* jacobian) const;

 private:
  struct Link {
    int view = 0;           // beside the lead
    Eigen::Vector3d share;  // the registered place on the body, of its size along x, y, z
    Eigen::Vector3d measured;
    Eigen::Matrix3d information;
    Eigen::Matrix<double, 3, 4> by_common;
  };
  /// @param information  what is then known of the common errors.
  Eigen::Vector4d common_errors(const std::vector<Eigen::Vector3d>& residuals,
                                Eigen::Matrix4d* information) const;

  PinholeCamera camera_;
  int lead_ = 0;
  double gate_squared_ = 1.0;
  std::vector<Link> links_;
  Eigen::Matrix4d common_information_ = Eigen::Matrix4d::Identity();  // prior
};

}  // namespace camber::internal
