#pragma once

// A vehicle touches its support plane: residual of its up axis and its bottom centre against the
// plane, which is itself uncertain.

#include "camber/vehicle/detail/body.h"
#include "camber/vehicle/detail/normal_equations.h"
#include "camber/vehicle/vehicle_noise.h"

namespace camber::internal {

using PoseVector = Eigen::Matrix<double, kPoseParameters, 1>;
using PoseMatrix = Eigen::Matrix<double, kPoseParameters, kPoseParameters>;
using ContactJacobian = Eigen::Matrix<double, 3, kPoseParameters>;

/// The contact, linear in plane and pose: residual e = M theta + noise for an error theta (tilt,
/// tilt, height) of the plane.
struct ContactTerms {
  Eigen::Vector3d residual;  ///< e: tilts (rad) and height (m) of the vehicle against the plane
  Eigen::Vector3d variance;  ///< of the noise
  ContactJacobian by_pose;   ///< de / d(translation, rotation)
  Eigen::Matrix3d by_plane;  ///< M; a change theta of the plane changes the residual by -M theta
};

/// A plane after a change (tilt, tilt, height) of its parameters, its axes turned with it.
UncertainPlane changed_plane(const UncertainPlane& plane, const Eigen::Vector3d& change);

class GroundContact {
 public:
  /// @param certain  the plane is never down-weighted.
  /// @param weight   of its cost: one over the number of views that share the plane.
  GroundContact(const SupportPlane& support, const ContactNoise& noise, bool certain,
                double weight);

  const UncertainPlane& plane() const { return plane_; }
  void set_plane(const UncertainPlane& plane) { plane_ = plane; }

  Eigen::Vector3d residual(const ViewPose& pose) const;
  ContactJacobian jacobian(const ViewPose& pose) const;
  /// M: d(residual) / d(error of the plane).
  Eigen::Matrix3d by_plane(const ViewPose& pose) const;
  /// Inverse covariance of the residual: of plane and noise.
  Eigen::Matrix3d information(const ViewPose& pose) const;
  ContactTerms terms(const ViewPose& pose) const;
  /// Squared Mahalanobis distance of the residual from 0.
  double squared_distance(const ViewPose& pose) const;

  /// Minus log density (Cauchy beyond the gate), optionally with its normal equations by the pose;
  /// the information is held, as it hardly depends on the pose.
  double evaluate(const ViewPose& pose, PoseMatrix* hessian, PoseVector* gradient) const;

  /// What the gradient of the cost by the pose falls by where the plane is raised by what its
  /// covariance leaves out (SupportPlane::unmodelled_height).
  PoseVector gradient_by_unmodelled(const ViewPose& pose) const;

  /// The ground as the vehicle that stands on it shows it too.
  struct Posterior {
    Eigen::Vector3d change;          ///< of the plane: tilt, tilt, height
    Eigen::Matrix3d covariance;      ///< of the changed plane
    ContactJacobian change_by_pose;  ///< d change / d pose, information held
    Eigen::Matrix3d by_plane_error;  ///< what is left of an error of the plane, the pose held
  };
  /// @param pose_covariance  of the solved pose parameters.
  Posterior posterior(const ViewPose& pose, const PoseMatrix& pose_covariance) const;

  /// Posterior mean of the plane, and the standard deviation of its height where the vehicle truly
  /// stands, at least that of the vehicle's place across the plane. The ego plane and a level one,
  /// which other vehicles stand on too, stay.
  /// @param raised  change of the pose by what the plane's covariance leaves out.
  /// @param place   covariance of the vehicle's centre, m^2: where it truly stands.
  Plane posterior_plane(const ViewPose& pose, const PoseMatrix& pose_covariance,
                        const PoseVector& raised, const Eigen::Matrix3d& place,
                        double* sigma_height) const;

 private:
  UncertainPlane plane_;
  bool shared_;  // with other vehicles
  double unmodelled_height_;
  Eigen::Vector3d noise_variance_;
  double gate_squared_;
  bool certain_;
  double weight_;
};

}  // namespace camber::internal
