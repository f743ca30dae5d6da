#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/road/ground_field.h"

namespace camber {

struct LocalPlaneOptions {
  double metres_per_unit = 1.0;  ///< scale of the field, > 0
  double length = 4.3;           ///< m, of the footprint behind the contact, > 0
  double half_width = 1.2;       ///< m, of the footprint, > 0
  double bumper_overhang = 0.0;  ///< m, from the contact seen to the footprint's near end
  /// Factor on the covariance, >= 1: errors of the matches that whole stretches of road share
  /// (moving shadows, reflections). Calibrated on rendered scenes.
  double inflation = 4.0;
  /// What the ground under a vehicle departs from a smooth field: ruts, potholes, undulations.
  double uneven_height = 0.03;  ///< m, >= 0
  double uneven_tilt = 0.01;    ///< rad, >= 0
};

struct LocalPlane {
  Status status = Status::kNotRun;  ///< kFailed: the ray to the contact does not meet the ground
  std::string reason;
  UncertainPlane plane;  ///< unit of the field; axis1 points away from the camera
  double support = 0.0;  ///< observations of the ground that carry the footprint
  /// The plane's parameters as linear functions of the field: 3 x N, d(tilt, tilt, height) /
  /// d(inverse depth at pixels).
  std::vector<Eigen::Vector2d> pixels;
  Eigen::MatrixXd by_field;
};

/// The plane of the ground under a vehicle: least squares over the footprint that begins where the
/// box's bottom edge meets the ground and reaches `length` beyond it, with the field's covariance.
/// @param contact  pixel of the box's bottom edge, middle.
/// @param shared_covariance  of the field's shared parameters; may be empty.
LocalPlane fit_local_plane(const GroundField& field, const PinholeCamera& camera,
                           const Eigen::Vector2d& contact, const Eigen::MatrixXd& shared_covariance,
                           const LocalPlaneOptions& options);

/// Joint covariance of planes of one field, 3 rows a plane in their order: the blocks on the
/// diagonal are the planes' own covariances.
Eigen::MatrixXd joint_covariance(const GroundField& field, const std::vector<LocalPlane>& planes,
                                 const Eigen::MatrixXd& shared_covariance,
                                 const LocalPlaneOptions& options);

/// A plane from its inverse-depth form rho = m . ray (n = -m d, up is negative y) with the
/// covariance of m: centroid where the ray of `pixel` meets it, axis1 along the view.
/// @param parameters  if not null, d(tilt, tilt, height) / dm.
UncertainPlane plane_from_inverse_depth(const Eigen::Vector3d& m, const Eigen::Matrix3d& covariance,
                                        const Eigen::Vector3d& centroid,
                                        Eigen::Matrix3d* parameters = nullptr);

}  // namespace camber
