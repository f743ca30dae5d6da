#include "support/drawn_road.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "camber/core/threads.h"

namespace camber::test {
namespace {

/// In [-1, 1], one value a cell.
double cell_value(int x, int y, int seed) {
  auto h = static_cast<std::uint32_t>(x) * 0x8DA6B343u ^
           static_cast<std::uint32_t>(y) * 0xD8163841u ^
           static_cast<std::uint32_t>(seed) * 0xCB1AB31Fu;
  h ^= h >> 13;
  h *= 0x5BD1E995u;
  h ^= h >> 15;
  return static_cast<double>(h & 0xFFFFu) / 32767.5 - 1.0;
}

/// Smooth noise with cells of one unit.
double noise(double x, double y, int seed) {
  const double fx = std::floor(x), fy = std::floor(y);
  const int ix = static_cast<int>(fx), iy = static_cast<int>(fy);
  double ax = x - fx, ay = y - fy;
  ax = ax * ax * (3 - 2 * ax);
  ay = ay * ay * (3 - 2 * ay);
  const double top = cell_value(ix, iy, seed) * (1 - ax) + cell_value(ix + 1, iy, seed) * ax;
  const double low =
      cell_value(ix, iy + 1, seed) * (1 - ax) + cell_value(ix + 1, iy + 1, seed) * ax;
  return top * (1 - ay) + low * ay;
}

/// Octaves from `smallest` cells up; those finer than a pixel's footprint are left out.
double texture(double x, double y, double smallest, double wide, double high, int seed) {
  double sum = 0.0;
  for (double cell = smallest; cell < 40 * smallest; cell *= 2.0) {
    const double blur = std::max(wide, high) / cell;
    if (blur > 1.5) continue;
    sum += (blur > 0.5 ? 1.5 - blur : 1.0) * noise(x / cell, y / cell, seed);
    ++seed;
  }
  return sum;
}

double sky(const Eigen::Vector3d& direction) {
  const double u = direction.x() / std::abs(direction.z());
  const double v = direction.y() / std::abs(direction.z());
  return 170.0 + 25.0 * texture(u, v, 0.01, 0.001, 0.001, 77);
}

/// Zero of f between two places of which it is negative at the first, by regula falsi (Illinois).
template <typename Function>
double meet(const Function& f, std::pair<double, double> low, std::pair<double, double> high) {
  while (high.first - low.first > 1e-10) {
    const double share = low.second / (low.second - high.second);
    const double s = low.first + share * (high.first - low.first);
    const double value = f(s);
    if (std::abs(value) < 1e-12) return s;
    if (value > 0) {
      high = {s, value};
      low.second *= 0.5;
    } else {
      low = {s, value};
      high.second *= 0.5;
    }
  }
  return 0.5 * (low.first + high.first);
}

/// Distance along the ray to the ground, NaN: none within 120 m.
double ground_along(const DrawnRoad& road, const Eigen::Vector3d& eye, const Eigen::Vector3d& ray) {
  const auto below = [&](double s) {
    const Eigen::Vector3d p = eye + s * ray;
    return p.y() - road.ground(p.x(), p.z());
  };
  double last = 0.5, over = below(last);
  if (over > 0) return std::numeric_limits<double>::quiet_NaN();
  for (double s = 0.7; s < 120.0; s *= 1.1) {
    const double under = below(s);
    if (under > 0) return meet(below, {last, over}, {s, under});
    last = s;
    over = under;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

std::vector<std::uint8_t> draw_road(const DrawnRoad& road, const PinholeCamera& camera,
                                    const SE3& world_from_camera, int frame) {
  const auto width = static_cast<std::size_t>(camera.width);
  std::vector<std::uint8_t> out(width * static_cast<std::size_t>(camera.height));
  const Eigen::Vector3d eye = world_from_camera.translation();
  const Eigen::Matrix3d rotation = world_from_camera.rotation_matrix();
  parallel_for(static_cast<std::size_t>(camera.height), 0, [&](std::size_t v) {
    for (std::size_t u = 0; u < width; ++u) {
      const Eigen::Vector3d ray =
          rotation * camera.ray(Eigen::Vector2d(static_cast<double>(u), static_cast<double>(v)));
      double value = sky(ray);
      const double s = ground_along(road, eye, ray);
      double nearest = std::isfinite(s) ? s : 1e9;
      if (std::isfinite(s)) {
        const Eigen::Vector3d p = eye + s * ray;
        const double wide = s / camera.fx;
        const double high = s * s / (camera.fy * std::max(0.3, std::abs(eye.y() - p.y())));
        if (road.wet(p.x(), p.z())) {
          value = 0.7 * sky({ray.x(), -std::abs(ray.y()), ray.z()});
        } else {
          value = (95.0 + 22.0 * texture(p.x(), p.z(), 0.03, wide, 0.5 * high, 5)) *
                  road.light(p.x(), p.z(), frame);
        }
      }
      for (const DrawnBoard& board : road.boards) {
        const double z = board.z + frame * board.shift_per_frame;
        const double along = (z - eye.z()) / ray.z();
        const Eigen::Vector3d p = eye + along * ray;
        if (!(along > 0.1) || along > nearest || p.x() < board.left || p.x() > board.right ||
            p.y() < board.top || p.y() > board.bottom) {
          continue;
        }
        nearest = along;
        const double wide = along / camera.fx;
        value = 120.0 + 35.0 * texture(p.x() + 50.0, p.y(), 0.05, wide, wide, 31);
      }
      const auto grain = 1.5 * cell_value(static_cast<int>(u), static_cast<int>(v), 1000 + frame);
      out[v * width + u] = static_cast<std::uint8_t>(std::clamp(value + grain, 0.0, 255.0));
    }
  });
  return out;
}

Eigen::Vector3d meet_road(const DrawnRoad& road, const PinholeCamera& camera,
                          const SE3& world_from_camera, const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d eye = world_from_camera.translation();
  const Eigen::Vector3d ray = world_from_camera.rotation_matrix() * camera.ray(pixel);
  const double s = ground_along(road, eye, ray);
  return std::isfinite(s) ? Eigen::Vector3d(eye + s * ray)
                          : Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
}

}  // namespace camber::test
