#pragma once

#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "camber/geometry/pinhole_camera.h"

namespace camber {

/// Reprojection error of a point that hangs on a viewing ray of the reference image:
/// r = (pi(R ray + rho t) - z) / sigma, in standard deviations.
/// Parameter blocks: pose frame_from_reference [qx qy qz qw tx ty tz] (7), inverse depth rho (1).
class InverseDepthReprojectionError {
 public:
  InverseDepthReprojectionError(const PinholeCamera& camera, const Eigen::Vector3d& ray,
                                const Eigen::Vector2d& pixel, double sigma_px)
      : camera_(camera), ray_(ray), pixel_(pixel), sigma_px_(sigma_px) {}

  static ceres::CostFunction* create(const PinholeCamera& camera, const Eigen::Vector3d& ray,
                                     const Eigen::Vector2d& pixel, double sigma_px) {
    return new ceres::AutoDiffCostFunction<InverseDepthReprojectionError, 2, 7, 1>(
        new InverseDepthReprojectionError(camera, ray, pixel, sigma_px));
  }

  template <typename T>
  bool operator()(const T* pose, const T* inverse_depth, T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(pose);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> translation(pose + 4);
    const Eigen::Matrix<T, 3, 1> p = rotation * ray_.cast<T>() + inverse_depth[0] * translation;
    if (!(p.z() > T(1e-6))) return false;
    residual[0] = (camera_.fx * p.x() / p.z() + camera_.cx - pixel_.x()) / sigma_px_;
    residual[1] = (camera_.fy * p.y() / p.z() + camera_.cy - pixel_.y()) / sigma_px_;
    return true;
  }

 private:
  PinholeCamera camera_;
  Eigen::Vector3d ray_;
  Eigen::Vector2d pixel_;
  double sigma_px_;
};

}  // namespace camber
