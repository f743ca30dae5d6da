#include "camber/import/depth_cloud.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

void require_size(int width, int height, const PinholeCamera& camera, const char* what) {
  if (width == camera.width && height == camera.height) return;
  throw std::invalid_argument(std::string(what) + " has " + std::to_string(width) + " x " +
                              std::to_string(height) + " px, expected the camera's " +
                              std::to_string(camera.width) + " x " + std::to_string(camera.height));
}

}  // namespace

RoadCloud cloud_from_depth(const DepthImage& depth, const PinholeCamera& camera, const Image* color,
                           const Image* labels, double largest) {
  camera.validate();
  require_size(depth.width, depth.height, camera, "depth image");
  if (color != nullptr) require_size(color->width, color->height, camera, "colour image");
  if (labels != nullptr) require_size(labels->width, labels->height, camera, "label image");
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  std::vector<int>* const classes = labels != nullptr ? &cloud.labels["class"] : nullptr;
  for (int v = 0; v < depth.height; ++v) {
    for (int u = 0; u < depth.width; ++u) {
      const std::size_t at = static_cast<std::size_t>(v) * static_cast<std::size_t>(depth.width) +
                             static_cast<std::size_t>(u);
      const float z = depth.metres[at];
      if (!std::isfinite(z) || z > largest) continue;
      cloud.points.push_back((static_cast<double>(z) * camera.ray({u, v})).cast<float>());
      if (color != nullptr) {
        const std::uint8_t* const pixel = color->row(v) + 3 * u;
        cloud.colors.push_back({pixel[0], pixel[1], pixel[2]});
      }
      if (classes != nullptr) classes->push_back(labels->row(v)[u]);
    }
  }
  return cloud;
}

}  // namespace camber
