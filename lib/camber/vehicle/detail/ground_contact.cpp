#include "camber/vehicle/detail/ground_contact.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "camber/geometry/se3.h"

namespace camber::internal {

UncertainPlane changed_plane(const UncertainPlane& plane, const Eigen::Vector3d& change) {
  const Eigen::Quaterniond turn =
      rotation_from_vector(change[0] * plane.axis1 + change[1] * plane.axis2);
  UncertainPlane out = plane;
  out.plane = plane.perturbed(change);
  out.axis1 = turn * plane.axis1;
  out.axis2 = turn * plane.axis2;
  return out;
}

GroundContact::GroundContact(const SupportPlane& support, const ContactNoise& noise, bool certain,
                             double weight)
    : plane_(support.plane),
      shared_(support.source == "ego" || support.source == "level"),
      unmodelled_height_(support.unmodelled_height),
      noise_variance_(noise.sigma_tilt * noise.sigma_tilt, noise.sigma_tilt * noise.sigma_tilt,
                      noise.sigma_height * noise.sigma_height),
      gate_squared_(noise.gate * noise.gate),
      certain_(certain),
      weight_(weight) {}

Eigen::Vector3d GroundContact::residual(const ViewPose& pose) const {
  const Eigen::Vector3d up = pose.rotation.col(1);
  return {-plane_.axis2.dot(up), plane_.axis1.dot(up),
          plane_.plane.signed_distance(pose.translation)};
}

ContactJacobian GroundContact::jacobian(const ViewPose& pose) const {
  ContactJacobian out = ContactJacobian::Zero();
  // up = R exp(w) e_y, d up = R (w x e_y): no part by w_y.
  const Eigen::Vector3d up_by_x = pose.rotation.col(2);   // e_x x e_y = e_z
  const Eigen::Vector3d up_by_z = -pose.rotation.col(0);  // e_z x e_y = -e_x
  out(0, 3) = -plane_.axis2.dot(up_by_x);
  out(0, 5) = -plane_.axis2.dot(up_by_z);
  out(1, 3) = plane_.axis1.dot(up_by_x);
  out(1, 5) = plane_.axis1.dot(up_by_z);
  out.block<1, 3>(2, 0) = plane_.plane.normal.transpose();
  return out;
}

Eigen::Matrix3d GroundContact::by_plane(const ViewPose& pose) const {
  Eigen::Matrix3d out = Eigen::Matrix3d::Identity();
  out.row(2) = plane_.height_jacobian(pose.translation);
  return out;
}

Eigen::Matrix3d GroundContact::information(const ViewPose& pose) const {
  const Eigen::Matrix3d m = by_plane(pose);
  Eigen::Matrix3d covariance = m * plane_.covariance * m.transpose();
  covariance.diagonal() += noise_variance_;
  return covariance.inverse();
}

ContactTerms GroundContact::terms(const ViewPose& pose) const {
  return {residual(pose), noise_variance_, jacobian(pose), by_plane(pose)};
}

double GroundContact::squared_distance(const ViewPose& pose) const {
  const Eigen::Vector3d e = residual(pose);
  return e.dot(information(pose) * e);
}

double GroundContact::evaluate(const ViewPose& pose, PoseMatrix* hessian,
                               PoseVector* gradient) const {
  const Eigen::Vector3d e = residual(pose);
  const Eigen::Matrix3d inverse = information(pose);
  const double squared = e.dot(inverse * e);
  // Views that share the plane down-weight it together.
  double cost = weight_ * (certain_ ? 0.5 * squared
                                    : 0.5 * gate_squared_ * std::log1p(squared / gate_squared_));
  // An upside-down vehicle has a small residual as well.
  constexpr double kUpsideDown = 1e3;
  if (pose.rotation.col(1).dot(plane_.plane.normal) < 0.0) cost += kUpsideDown;
  if (hessian) {
    const double weight = weight_ * (certain_ ? 1.0 : 1.0 / (1.0 + squared / gate_squared_));
    const ContactJacobian j = jacobian(pose);
    const ContactJacobian weighted = weight * inverse * j;
    *hessian = j.transpose() * weighted;
    *gradient = weighted.transpose() * e;
  }
  return cost;
}

PoseVector GroundContact::gradient_by_unmodelled(const ViewPose& pose) const {
  const double weight =
      weight_ * (certain_ ? 1.0 : 1.0 / (1.0 + squared_distance(pose) / gate_squared_));
  return weight * unmodelled_height_ *
         (jacobian(pose).transpose() * information(pose) * by_plane(pose).col(2));
}

GroundContact::Posterior GroundContact::posterior(const ViewPose& pose,
                                                  const PoseMatrix& pose_covariance) const {
  const double widening = certain_ ? 1.0 : 1.0 + squared_distance(pose) / gate_squared_;
  const Eigen::Matrix3d m = by_plane(pose);
  const Eigen::Matrix3d prior = widening * plane_.covariance;
  Eigen::Matrix3d sum = m * prior * m.transpose();
  sum.diagonal() += noise_variance_;
  const Eigen::Matrix3d gain = prior * m.transpose() * sum.inverse();
  Posterior out;
  out.change = gain * residual(pose);
  out.change_by_pose = gain * jacobian(pose);
  out.by_plane_error = Eigen::Matrix3d::Identity() - gain * m;
  out.covariance = prior - gain * m * prior +
                   out.change_by_pose * pose_covariance * out.change_by_pose.transpose();
  return out;
}

Plane GroundContact::posterior_plane(const ViewPose& pose, const PoseMatrix& pose_covariance,
                                     const PoseVector& raised, const Eigen::Matrix3d& place,
                                     double* sigma_height) const {
  if (shared_) {
    *sigma_height = std::hypot(std::sqrt(std::max(plane_.height_variance(pose.translation), 0.0)),
                               unmodelled_height_);
    return plane_.plane;
  }
  const Posterior after = posterior(pose, pose_covariance);
  const Eigen::RowVector3d height = plane_.height_jacobian(pose.translation);
  // The vehicle may stand elsewhere on the plane, whose tilt then counts.
  Eigen::Matrix<double, 2, 3> arm;
  arm.row(0) = plane_.axis2.transpose();
  arm.row(1) = -plane_.axis1.transpose();
  const Eigen::Matrix2d tilt = after.covariance.topLeftCorner<2, 2>();
  const double elsewhere = tilt.cwiseProduct(arm * place * arm.transpose()).sum();
  const double variance = height * after.covariance * height.transpose();
  const double unmodelled =
      height * (unmodelled_height_ * after.by_plane_error.col(2) + after.change_by_pose * raised);
  const Plane plane = plane_.perturbed(after.change);
  // The same at the normal that was found: on ground hardly known that is far from the one at
  // which the plane was linearised, and `place` also holds what contradicts the vehicle.
  const double across = plane.normal.dot(place * plane.normal);
  *sigma_height = std::sqrt(std::max(
      std::max(variance, 0.0) + std::max(elsewhere, 0.0) + unmodelled * unmodelled, across));
  return plane;
}

}  // namespace camber::internal
