#include "camber/geometry/plane.h"

#include <cmath>

namespace camber {

Plane Plane::transformed(const SE3& b_from_a) const {
  Plane out;
  out.normal = b_from_a.rotation() * normal;
  out.offset = offset - out.normal.dot(b_from_a.translation());
  return out;
}

Plane Plane::oriented(const Eigen::Vector3d& up) const {
  if (normal.dot(up) >= 0.0) return *this;
  return {-normal, -offset};
}

std::optional<Eigen::Vector3d> Plane::intersect_ray(const Eigen::Vector3d& direction) const {
  const double along = normal.dot(direction);
  if (along == 0.0) return std::nullopt;
  const double s = -offset / along;
  if (!(s > 0.0)) return std::nullopt;
  return Eigen::Vector3d(s * direction);
}

Eigen::RowVector3d UncertainPlane::height_jacobian(const Eigen::Vector3d& x) const {
  const Eigen::Vector3d r = x - centroid;
  return {axis2.dot(r), -axis1.dot(r), 1.0};
}

double UncertainPlane::height_variance(const Eigen::Vector3d& x) const {
  const Eigen::RowVector3d j = height_jacobian(x);
  return j * covariance * j.transpose();
}

Plane UncertainPlane::perturbed(const Eigen::Vector3d& abh) const {
  const Eigen::Vector3d tilt = abh.x() * axis1 + abh.y() * axis2;
  const Eigen::Vector3d normal = (rotation_from_vector(tilt) * plane.normal).normalized();
  return Plane::through(plane.foot(centroid) + abh.z() * plane.normal, normal);
}

UncertainPlane UncertainPlane::transformed(const SE3& b_from_a) const {
  UncertainPlane out;
  out.plane = plane.transformed(b_from_a);
  out.centroid = b_from_a * centroid;
  out.axis1 = b_from_a.rotation() * axis1;
  out.axis2 = b_from_a.rotation() * axis2;
  out.covariance = covariance;
  return out;
}

void UncertainPlane::make_axes(const Eigen::Vector3d& normal, const Eigen::Vector3d& along,
                               Eigen::Vector3d* axis1, Eigen::Vector3d* axis2) {
  Eigen::Vector3d a = along - normal.dot(along) * normal;
  if (a.norm() < 1e-6 * along.norm() || !(along.norm() > 0.0)) a = normal.unitOrthogonal();
  *axis1 = a.normalized();
  *axis2 = normal.cross(*axis1).normalized();
}

double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace camber
