#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/road/road_posterior.h"

namespace camber {

struct LocalPlaneOptions {
  double length = 4.3;           ///< m, of the footprint behind the contact, > 0
  double half_width = 1.2;       ///< m, of the footprint, > 0
  double bumper_overhang = 0.0;  ///< m, from the contact seen to the footprint's near end, finite
  /// What the ground under a vehicle departs from a smooth field: ruts, potholes, undulations.
  double uneven_height = 0.03;  ///< m, >= 0
  double uneven_tilt = 0.01;    ///< rad, >= 0

  /// Variances of tilt, tilt and height by that.
  Eigen::Vector3d uneven_variances() const {
    const double tilt = uneven_tilt * uneven_tilt;
    return {tilt, tilt, uneven_height * uneven_height};
  }
  void validate() const;  ///< throws std::invalid_argument
};

struct LocalPlane {
  Status status = Status::kNotRun;  ///< kFailed: the ray to the contact does not meet the ground
  std::string reason;
  UncertainPlane plane;   ///< m; axis1 points away from the camera
  double observed = 0.0;  ///< observations of the ground that carry the footprint
  /// The plane's (tilt, tilt, height) as linear functions of the metric inverse depths at pixels:
  /// 3 x N.
  std::vector<Eigen::Vector2d> pixels;
  Eigen::MatrixXd by_inverse_depth;
};

/// The plane of the ground under a vehicle: least squares over the footprint that begins where the
/// box's bottom edge meets the ground and reaches `length` beyond it, with the road's covariance.
/// @param contact  pixel of the box's bottom edge, middle.
LocalPlane fit_local_plane(const RoadPosterior& road, const PinholeCamera& camera,
                           const Eigen::Vector2d& contact, const LocalPlaneOptions& options);

/// Joint covariance of planes of one road, 3 rows a plane in their order: the blocks on the
/// diagonal are the planes' own covariances.
Eigen::MatrixXd joint_covariance(const RoadPosterior& road, const std::vector<LocalPlane>& planes,
                                 const LocalPlaneOptions& options);

/// A plane from its inverse-depth form rho = m . ray (n = -m d, up is negative y) with the
/// covariance of m: centroid where the ray of `pixel` meets it, axis1 along the view.
/// @param parameters  if not null, d(tilt, tilt, height) / dm.
UncertainPlane plane_from_inverse_depth(const Eigen::Vector3d& m, const Eigen::Matrix3d& covariance,
                                        const Eigen::Vector3d& centroid,
                                        Eigen::Matrix3d* parameters = nullptr);

}  // namespace camber
