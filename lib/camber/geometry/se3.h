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
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation);
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation);
  /// From a 4 x 4 (or 3 x 4 padded) homogeneous matrix whose 3 x 3 block is a rotation.
  static SE3 from_matrix(const Eigen::Matrix4d& matrix);

  Eigen::Quaterniond rotation() const { return {data_[3], data_[0], data_[1], data_[2]}; }
  Eigen::Matrix3d rotation_matrix() const;
  Eigen::Vector3d translation() const { return {data_[4], data_[5], data_[6]}; }
  void set_translation(const Eigen::Vector3d& t) {
    data_[4] = t.x();
    data_[5] = t.y();
    data_[6] = t.z();
  }
  Eigen::Matrix4d matrix() const;

  SE3 inverse() const;
  SE3 operator*(const SE3& other) const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation() * point + translation();
  }

  double* data() { return data_.data(); }
  const double* data() const { return data_.data(); }

 private:
  std::array<double, 7> data_;
};

/// Rotation of |v| radians about v / |v| (Rodrigues); the identity for v = 0.
Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& v);

/// The rotation vector of q, |v| in [0, pi].
Eigen::Vector3d rotation_to_vector(const Eigen::Quaterniond& q);

/// The matrix [v]x with [v]x w = v x w.
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

}  // namespace camber
