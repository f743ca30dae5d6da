#include "camber/cloud/units.h"

#include <stdexcept>

namespace camber {

void to_metres(RoadCloud* cloud, const CoordinateSystem& system) {
  if (system.horizontal.angle || system.vertical.angle) {
    throw std::invalid_argument("the coordinates are angles, expected lengths");
  }
  if (system.metric()) return;
  const Eigen::Vector3d factor(system.horizontal.metres, system.horizontal.metres,
                               system.vertical.metres);
  const Eigen::Vector3f f = factor.cast<float>();
  cloud->origin = cloud->origin.cwiseProduct(factor);
  // In double: a foot is no float.
  for (Eigen::Vector3f& p : cloud->points) {
    p = p.cast<double>().cwiseProduct(factor).cast<float>();
  }
  for (float& sigma : cloud->sigmas) sigma *= f.x();
  for (std::array<float, 6>& c : cloud->covariances) {
    std::size_t k = 0;
    for (int row = 0; row < 3; ++row) {
      for (int column = row; column < 3; ++column) c[k++] *= f[row] * f[column];
    }
  }
  for (Eigen::Vector3f& n : cloud->normals) {
    const Eigen::Vector3f turned = n.cwiseQuotient(f);
    if (turned.norm() > 0.0f) n = turned.normalized();
  }
  cloud->metric = true;
}

}  // namespace camber
