#include "camber/vehicle/detail/convex_hull.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace camber::internal {

std::vector<HalfSpace> convex_hull(const std::array<Eigen::Vector3d, kNumKeypoints>& points) {
  std::vector<HalfSpace> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        Eigen::Vector3d n = (points[j] - points[i]).cross(points[k] - points[i]);
        const double length = n.norm();
        if (!(length > 1e-4)) continue;
        n /= length;
        const double d = n.dot(points[i]);
        bool below = true, above = true;
        for (std::size_t m = 0; m < points.size() && (below || above); ++m) {
          const double e = n.dot(points[m]) - d;
          below &= e < 1e-6;
          above &= e > -1e-6;
        }
        if (!below && !above) continue;
        const HalfSpace face = below ? HalfSpace{n, d} : HalfSpace{-n, -d};
        const bool known = std::any_of(out.begin(), out.end(), [&](const HalfSpace& other) {
          return (other.normal - face.normal).squaredNorm() < 1e-10;
        });
        if (!known) out.push_back(face);
      }
    }
  }
  return out;
}

double hull_depth(const std::vector<HalfSpace>& hull, const Eigen::Vector3d& ray) {
  double enter = 0.0, leave = 1e9;
  for (const HalfSpace& h : hull) {
    const double along = h.normal.dot(ray);
    if (along < -1e-9) {
      enter = std::max(enter, h.offset / along);
    } else if (along > 1e-9) {
      leave = std::min(leave, h.offset / along);
    } else if (h.offset < 0.0) {
      return 0.0;
    }
  }
  return enter > 0.1 && enter < leave ? enter : 0.0;
}

}  // namespace camber::internal
