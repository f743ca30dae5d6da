#include "camber/evaluate/depth_truth.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kStep = 0.3;           // m between neighbours of one surface
constexpr double kRelativeStep = 0.15;  // of the depth: level ground seen from 1.5 m at f = 420 px

bool joined(double a, double b) {
  return std::abs(a - b) <= std::max(kStep, kRelativeStep * std::min(a, b));
}

}  // namespace

Shape ground_mesh_from_depth(const DepthImage& depth, const PinholeCamera& camera,
                             const Image* labels, const std::set<int>& classes, double largest) {
  const int width = depth.width, height = depth.height;
  const std::size_t count = static_cast<std::size_t>(width) * height;
  if (width != camera.width || height != camera.height || depth.metres.size() != count ||
      (labels && labels->data.size() != count)) {
    throw std::invalid_argument("ground_mesh_from_depth: sizes differ, expected the camera's");
  }
  Shape out;
  out.cloud.frame = CloudFrame::kCamera;
  std::vector<int> vertex(count, -1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * width + x;
      const double z = depth.metres[at];
      if (!(z > 0.0 && z <= largest)) continue;
      if (labels && !classes.count(labels->data[at])) continue;
      vertex[at] = static_cast<int>(out.cloud.points.size());
      out.cloud.points.emplace_back((x - camera.cx) / camera.fx * z,
                                    (y - camera.cy) / camera.fy * z, z);
    }
  }
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    if (vertex[a] < 0 || vertex[b] < 0 || vertex[c] < 0) return;
    const double za = depth.metres[a], zb = depth.metres[b], zc = depth.metres[c];
    if (!joined(za, zb) || !joined(zb, zc) || !joined(zc, za)) return;
    out.triangles.push_back({static_cast<std::uint32_t>(vertex[a]),
                             static_cast<std::uint32_t>(vertex[b]),
                             static_cast<std::uint32_t>(vertex[c])});
  };
  for (int y = 0; y + 1 < height; ++y) {
    for (int x = 0; x + 1 < width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * width + x, below = at + width;
      add(at, below, at + 1);
      add(at + 1, below, below + 1);
    }
  }
  if (out.triangles.empty()) out.cloud = {};
  return out;
}

}  // namespace camber
