#include "camber/scale/camera_uncertainty.h"

#include <cmath>

namespace camber {

CameraUncertainty::CameraUncertainty(const PinholeCamera& camera, const CameraSigma& sigma,
                                     double scale_by_focal)
    : sigma_(sigma), focal_px_(0.5 * (camera.fx + camera.fy)), scale_by_focal_(scale_by_focal) {
  // The road that a height is measured over is seen best at the image's lower edge.
  const double lower_edge = (camera.height - 1.0 - camera.cy) / camera.fy;
  scale_by_distortion_ = scale_by_focal * lower_edge * lower_edge;
}

Eigen::Vector3d CameraUncertainty::displacement(Intrinsic intrinsic,
                                                const Eigen::Vector3d& p) const {
  switch (intrinsic) {
    case kFocal:
      return sigma_.focal * Eigen::Vector3d((scale_by_focal_ - 1.0) * p.x(),
                                            (scale_by_focal_ - 1.0) * p.y(),
                                            scale_by_focal_ * p.z());
    case kPrincipalX:
      return {-sigma_.principal / focal_px_ * p.z(), 0.0, 0.0};
    case kPrincipalY:
      return {0.0, -sigma_.principal / focal_px_ * p.z(), 0.0};
    default:
      break;
  }
  if (p.z() == 0.0) return Eigen::Vector3d::Zero();
  const double r2 = p.head<2>().squaredNorm() / (p.z() * p.z());
  Eigen::Vector3d out = scale_by_distortion_ * p;
  out.head<2>() -= r2 * p.head<2>();
  return sigma_.distortion * out;
}

Eigen::Matrix<double, 3, 4> CameraUncertainty::displacements(const Eigen::Vector3d& point) const {
  static_assert(kCount == 4, "a column each");
  Eigen::Matrix<double, 3, 4> out;
  for (int i = 0; i < kCount; ++i) out.col(i) = displacement(static_cast<Intrinsic>(i), point);
  return out;
}

Eigen::Matrix3d CameraUncertainty::gradient(Intrinsic intrinsic, const Eigen::Vector3d& p) const {
  Eigen::Matrix3d out;
  if (intrinsic != kDistortion) {
    for (int i = 0; i < 3; ++i) out.col(i) = displacement(intrinsic, Eigen::Vector3d::Unit(i));
    return out;
  }
  if (p.z() == 0.0) return Eigen::Matrix3d::Zero();
  const Eigen::Vector2d xy = p.head<2>() / p.z();
  const double r2 = xy.squaredNorm();
  out = scale_by_distortion_ * Eigen::Matrix3d::Identity();
  out.topLeftCorner<2, 2>() -= r2 * Eigen::Matrix2d::Identity() + 2.0 * xy * xy.transpose();
  out.topRightCorner<2, 1>() += 2.0 * r2 * xy;
  return sigma_.distortion * out;
}

Eigen::Matrix3d CameraUncertainty::position_covariance(const Eigen::Vector3d& point) const {
  const Eigen::Matrix<double, 3, 4> by = displacements(point);
  return by * by.transpose();
}

double CameraUncertainty::distance_variance(const Eigen::Vector3d& point) const {
  const double distance = point.norm();
  if (!(distance > 0.0)) return 0.0;
  const Eigen::Vector3d ray = point / distance;
  return ray.dot(position_covariance(point) * ray);
}

double CameraUncertainty::log_length_variance(const Eigen::Vector3d& direction) const {
  const Eigen::Vector3d unit = direction.normalized();
  double out = 0.0;
  for (int i = 0; i < kCount; ++i) {
    const double change =
        unit.dot(gradient(static_cast<Intrinsic>(i), Eigen::Vector3d::UnitZ()) * unit);
    out += change * change;
  }
  return out;
}

double CameraUncertainty::log_length_variance_by_focal(const Eigen::Vector3d& direction) const {
  const Eigen::Vector3d unit = direction.normalized();
  const double change = unit.dot(gradient(kFocal, Eigen::Vector3d::UnitZ()) * unit);
  return change * change;
}

Eigen::Matrix3d CameraUncertainty::plane_covariance(const UncertainPlane& plane) const {
  const Eigen::Vector3d& n = plane.plane.normal;
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (int i = 0; i < kCount; ++i) {
    const auto intrinsic = static_cast<Intrinsic>(i);
    // A surface's normal moves by -G' n, of which the part in the plane is its tilt:
    // (a axis1 + b axis2) x n = b axis1 - a axis2.
    const Eigen::Vector3d turn = -(gradient(intrinsic, plane.centroid).transpose() * n);
    const Eigen::Vector3d change(-turn.dot(plane.axis2), turn.dot(plane.axis1),
                                 n.dot(displacement(intrinsic, plane.centroid)));
    out += change * change.transpose();
  }
  return out;
}

}  // namespace camber
