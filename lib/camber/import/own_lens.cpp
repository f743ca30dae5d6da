#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <optional>

#include "camber/geometry/lens_map.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

/// Where an edge of a box is seen without the lens: the mean over its middle half, since a vehicle
/// touches it somewhere there, hardly ever in a corner. NaN where the lens shows nothing of it.
Eigen::Vector2d carried(const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                        const LensMap& map) {
  constexpr int kSteps = 8;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const auto pixel = map.pinhole_from_raw(from + (0.25 + 0.5 * i / kSteps) * (to - from));
    if (!pixel) continue;
    sum += *pixel;
    ++count;
  }
  return sum / count;
}

/// A side of a box, cut at the border beyond which the lens's model does not reach.
bool cut(double* low, double* high, double size) {
  if (std::isnan(*low) && std::isnan(*high)) return false;
  if (std::isnan(*low)) *low = 0.0;
  if (std::isnan(*high)) *high = size;
  return *low < *high && *high >= 1.0 && *low <= size - 1.0;
}

/// The box of what a box of the file shows; nothing where that lies outside the pinhole camera's
/// image.
std::optional<Box2> carried(const Box2& box, const LensMap& map, const PinholeCamera& camera) {
  const Eigen::Vector2d a(box.x1, box.y1), b(box.x2, box.y1), c(box.x2, box.y2), d(box.x1, box.y2);
  Box2 out{carried(a, d, map).x(), carried(a, b, map).y(), carried(b, c, map).x(),
           carried(d, c, map).y()};
  if (!cut(&out.x1, &out.x2, camera.width) || !cut(&out.y1, &out.y2, camera.height)) {
    return std::nullopt;
  }
  return out;
}

}  // namespace

const PinholeCamera& file_camera(const Scene& scene) {
  return scene.distortion.raw.width > 0 ? scene.distortion.raw : scene.camera;
}

void take_out_lens(Scene& scene, OwnImport& out) {
  if (scene.distortion.model == LensModel::kNone) return;
  scene.camera = undistorted_camera(scene.distortion);
  const LensMap map(scene.camera, scene.distortion);
  std::size_t outside = 0;
  for (SceneFrame& frame : scene.frames) {
    std::vector<VehicleDetection> inside;
    for (VehicleDetection& vehicle : frame.vehicles) {
      const std::optional<Box2> box = carried(vehicle.box, map, scene.camera);
      if (!box) {
        ++outside;
        continue;
      }
      vehicle.box = *box;
      for (KeypointObservation& keypoint : vehicle.keypoints) {
        if (!keypoint.pixel.allFinite()) continue;
        const auto pixel = map.pinhole_from_raw(keypoint.pixel);
        keypoint.pixel =
            pixel ? *pixel : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
      }
      inside.push_back(std::move(vehicle));
    }
    frame.vehicles = std::move(inside);
  }
  if (outside > 0) {
    out.found.push_back(
        fmt::format("{} boxes left out, which the image without the lens does not show", outside));
  }
  out.found.push_back(
      fmt::format("the lens is taken out on reading: {} x {} pixels, cx {:.6g} cy "
                  "{:.6g}",
                  scene.camera.width, scene.camera.height, scene.camera.cx, scene.camera.cy));
}

}  // namespace camber
