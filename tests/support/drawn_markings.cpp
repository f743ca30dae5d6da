#include "drawn_markings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber::test {
namespace {

struct Axes {
  Eigen::Vector3d foot, right, ahead;
  explicit Axes(const Plane& road) : foot(road.foot(Eigen::Vector3d::Zero())) {
    const Eigen::Vector3d& n = road.normal;
    ahead = (Eigen::Vector3d::UnitZ() - n.z() * n).normalized();
    right = ahead.cross(n);
  }
};

}  // namespace

Eigen::Vector2d on_plane(const PinholeCamera& camera, const Plane& road,
                         const Eigen::Vector2d& pixel) {
  const Axes axes(road);
  const Eigen::Vector3d ray = camera.ray(pixel);
  const Eigen::Vector3d p = -road.offset / road.normal.dot(ray) * ray - axes.foot;
  return {p.dot(axes.right), p.dot(axes.ahead)};
}

Eigen::Vector2d pixel_on_plane(const PinholeCamera& camera, const Plane& road,
                               const Eigen::Vector2d& place) {
  const Axes axes(road);
  return *camera.project(axes.foot + place.x() * axes.right + place.y() * axes.ahead);
}

GrayImage draw_markings(const PinholeCamera& camera, const Plane& road, const Paint& paint,
                        double noise, std::uint64_t seed) {
  GrayImage out{camera.width, camera.height, {}};
  const CounterRandom random(seed, 0);
  constexpr int kParts = 5;
  std::uint64_t counter = 0;
  for (int v = 0; v < out.height; ++v) {
    for (int u = 0; u < out.width; ++u) {
      double painted = 0.0;
      bool sky = false;
      for (int a = 0; a < kParts && !sky; ++a) {
        for (int b = 0; b < kParts && !sky; ++b) {
          const Eigen::Vector2d at(u - 0.5 + (b + 0.5) / kParts, v - 0.5 + (a + 0.5) / kParts);
          sky = !(road.normal.dot(camera.ray(at)) < -1e-3);
          if (sky) continue;
          const Eigen::Vector2d place = on_plane(camera, road, at);
          painted += paint(place.x(), place.y()) ? 1.0 / (kParts * kParts) : 0.0;
        }
      }
      const double grey = (sky ? 180.0 : 90.0 + 100.0 * painted) + noise * random.normal(counter++);
      out.pixels.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(grey, 0.0, 255.0))));
    }
  }
  return out;
}

bool dashed(double x, double z, double offset, double start) {
  const double along = z - start;
  return std::abs(x - offset) < 0.06 && along > 0 && std::fmod(along, 9.0) < 3.0;
}

}  // namespace camber::test
