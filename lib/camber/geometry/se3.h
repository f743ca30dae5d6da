#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

namespace camber {

/// Rigid transform, stored contiguously as [qx qy qz qw tx ty tz] so that a solver can take data()
/// without copying. `b_from_a * x_in_a` gives x_in_b.
class SE3 {
 public:
  SE3() : data_{0, 0, 0, 1, 0, 0, 0} {}
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
    const Eigen::Quaterniond q = rotation.normalized();
    data_ = {q.x(), q.y(), q.z(), q.w(), translation.x(), translation.y(), translation.z()};
  }
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : SE3(Eigen::Quaterniond(rotation), translation) {}
  /// From a 4 x 4 (or 3 x 4 padded) homogeneous matrix whose 3 x 3 block is a rotation.
  static SE3 from_matrix(const Eigen::Matrix4d& matrix) {
    return {Eigen::Matrix3d(matrix.topLeftCorner<3, 3>()),
            Eigen::Vector3d(matrix.topRightCorner<3, 1>())};
  }

  Eigen::Quaterniond rotation() const { return {data_[3], data_[0], data_[1], data_[2]}; }
  Eigen::Matrix3d rotation_matrix() const { return rotation().toRotationMatrix(); }
  Eigen::Vector3d translation() const { return {data_[4], data_[5], data_[6]}; }
  void set_translation(const Eigen::Vector3d& t) {
    data_[4] = t.x();
    data_[5] = t.y();
    data_[6] = t.z();
  }
  Eigen::Matrix4d matrix() const {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    m.topLeftCorner<3, 3>() = rotation_matrix();
    m.topRightCorner<3, 1>() = translation();
    return m;
  }

  SE3 inverse() const {
    const Eigen::Quaterniond q = rotation().conjugate();
    return {q, -(q * translation())};
  }
  SE3 operator*(const SE3& other) const {
    return {rotation() * other.rotation(), rotation() * other.translation() + translation()};
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation() * point + translation();
  }

  double* data() { return data_.data(); }
  const double* data() const { return data_.data(); }

 private:
  std::array<double, 7> data_;
};

/// Rotation of |v| radians about v / |v| (Rodrigues); the identity for v = 0.
inline Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle < 1e-12) {
    return Eigen::Quaterniond(1.0, 0.5 * v.x(), 0.5 * v.y(), 0.5 * v.z()).normalized();
  }
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, v / angle));
}

/// The rotation vector of q, |v| in [0, pi].
inline Eigen::Vector3d rotation_to_vector(const Eigen::Quaterniond& q) {
  const Eigen::AngleAxisd a(q.w() < 0 ? Eigen::Quaterniond(-q.coeffs()) : q);
  return a.angle() * a.axis();
}

/// The matrix [v]x with [v]x w = v x w.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace camber
