#include "camber/geometry/box.h"

#include <cmath>

namespace camber {

double intersection_over_union(const Box2& a, const Box2& b) {
  const Box2 both{std::max(a.x1, b.x1), std::max(a.y1, b.y1), std::min(a.x2, b.x2),
                  std::min(a.y2, b.y2)};
  if (both.x2 <= both.x1 || both.y2 <= both.y1) return 0.0;
  const double shared = both.area();
  return shared / (a.area() + b.area() - shared);
}

Eigen::Vector3d OrientedBox::center() const {
  return camera_from_vehicle * Eigen::Vector3d(0.0, 0.5 * dimensions.height, 0.0);
}

Eigen::Matrix<double, 3, 8> OrientedBox::corners() const {
  Eigen::Matrix<double, 3, 8> out;
  const double l = 0.5 * dimensions.length, w = 0.5 * dimensions.width;
  const double xs[4] = {l, l, -l, -l}, zs[4] = {-w, w, w, -w};
  for (int i = 0; i < 8; ++i) {
    out.col(i) = camera_from_vehicle *
                 Eigen::Vector3d(xs[i % 4], i < 4 ? 0.0 : dimensions.height, zs[i % 4]);
  }
  return out;
}

double rotation_y(const Eigen::Matrix3d& camera_from_vehicle) {
  const Eigen::Vector3d f = camera_from_vehicle.col(0);
  return std::atan2(-f.z(), f.x());
}

Eigen::Matrix3d rotation_from_rotation_y(double ry) {
  Eigen::Matrix3d r;
  r.col(0) = Eigen::Vector3d(std::cos(ry), 0.0, -std::sin(ry));
  r.col(1) = Eigen::Vector3d(0.0, -1.0, 0.0);
  r.col(2) = r.col(0).cross(r.col(1));
  return r;
}

}  // namespace camber
