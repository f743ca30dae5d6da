#include "camber/geometry/se3.h"

namespace camber {

SE3::SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
  const Eigen::Quaterniond q = rotation.normalized();
  data_ = {q.x(), q.y(), q.z(), q.w(), translation.x(), translation.y(), translation.z()};
}

SE3::SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
    : SE3(Eigen::Quaterniond(rotation), translation) {}

SE3 SE3::from_matrix(const Eigen::Matrix4d& matrix) {
  return {Eigen::Matrix3d(matrix.topLeftCorner<3, 3>()),
          Eigen::Vector3d(matrix.topRightCorner<3, 1>())};
}

Eigen::Matrix3d SE3::rotation_matrix() const { return rotation().toRotationMatrix(); }

Eigen::Matrix4d SE3::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation_matrix();
  m.topRightCorner<3, 1>() = translation();
  return m;
}

SE3 SE3::inverse() const {
  const Eigen::Quaterniond q = rotation().conjugate();
  return {q, -(q * translation())};
}

SE3 SE3::operator*(const SE3& other) const {
  return {rotation() * other.rotation(), rotation() * other.translation() + translation()};
}

Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle < 1e-12) {
    return Eigen::Quaterniond(1.0, 0.5 * v.x(), 0.5 * v.y(), 0.5 * v.z()).normalized();
  }
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, v / angle));
}

Eigen::Vector3d rotation_to_vector(const Eigen::Quaterniond& q) {
  const Eigen::AngleAxisd a(q.w() < 0 ? Eigen::Quaterniond(-q.coeffs()) : q);
  return a.angle() * a.axis();
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace camber
