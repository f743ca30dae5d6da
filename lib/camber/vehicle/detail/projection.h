#pragma once

#include <Eigen/Core>

#include "camber/geometry/pinhole_camera.h"

namespace camber::internal {

/// d(u, v, log z) / dx of a point in the camera frame, in front of the camera; px and 1 over m.
inline Eigen::Matrix3d projection_jacobian(const PinholeCamera& camera, const Eigen::Vector3d& x) {
  const double iz = 1.0 / x.z();
  Eigen::Matrix3d out;
  out << camera.fx * iz, 0.0, -camera.fx * x.x() * iz * iz,  //
      0.0, camera.fy * iz, -camera.fy * x.y() * iz * iz,     //
      0.0, 0.0, iz;
  return out;
}

}  // namespace camber::internal
