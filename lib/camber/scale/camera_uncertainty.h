#pragma once

#include <Eigen/Core>
#include <array>

#include "camber/geometry/camera_sigma.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"

namespace camber {

/// What a camera that is not exactly known leaves open in a reconstruction.
///
/// Images of a camera that moves without turning are explained equally well by a camera K' and the
/// world stretched by s K'^-1 K, the affine ambiguity (Hartley and Zisserman, Multiple View
/// Geometry, 2nd ed., 10.4.1): with a focal length 1 % too long everything is 1 % longer along the
/// optical axis than across it, and what gives the metres decides which of the two is right. To
/// first order a point p moves by a displacement that is linear in each intrinsic's error; a radial
/// distortion that is left in moves it across the axis by the square of its distance from there.
class CameraUncertainty {
 public:
  CameraUncertainty() = default;
  /// @param scale_by_focal  derivative of the logarithm of the scale (of lengths along the axis) by
  ///        that of the focal length: 1 where a length across the view gives the metres (the
  ///        camera's height, a road's or a vehicle's width), 0 where one along it does (poses,
  ///        speed, dashes).
  CameraUncertainty(const PinholeCamera& camera, const CameraSigma& sigma, double scale_by_focal);

  bool exact() const { return sigma_.exact(); }

  /// What points move by, camera frame, m, with one standard deviation of the focal length, of
  /// either coordinate of the principal point and of the distortion: a column each.
  Eigen::Matrix<double, 3, 4> displacements(const Eigen::Vector3d& point) const;

  /// Covariance of a point, camera frame, m^2.
  Eigen::Matrix3d position_covariance(const Eigen::Vector3d& point) const;

  /// Variance of a point's distance from the camera, m^2; 0 at the camera.
  double distance_variance(const Eigen::Vector3d& point) const;

  /// Variance of the logarithm of a length near the optical axis. @param direction  not zero.
  double log_length_variance(const Eigen::Vector3d& direction) const;
  /// The part of it that comes from the focal length.
  double log_length_variance_by_focal(const Eigen::Vector3d& direction) const;

  /// Covariance of a plane's (tilt about axis1, tilt about axis2, height at the centroid).
  Eigen::Matrix3d plane_covariance(const UncertainPlane& plane) const;

 private:
  enum Intrinsic { kFocal, kPrincipalX, kPrincipalY, kDistortion, kCount };

  /// Of a point by one standard deviation of an intrinsic.
  Eigen::Vector3d displacement(Intrinsic intrinsic, const Eigen::Vector3d& point) const;
  /// d displacement / d point.
  Eigen::Matrix3d gradient(Intrinsic intrinsic, const Eigen::Vector3d& point) const;

  CameraSigma sigma_;
  double focal_px_ = 1.0;
  double scale_by_focal_ = 1.0, scale_by_distortion_ = 0.0;
};

}  // namespace camber
