#include <fmt/format.h>

#include <limits>

#include "camber/geometry/lens_map.h"
#include "camber/scene/import_own.h"

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

/// The box of what a box of the file shows; as it is where the lens does not show an edge.
Box2 carried(const Box2& box, const LensMap& map) {
  const Eigen::Vector2d a(box.x1, box.y1), b(box.x2, box.y1), c(box.x2, box.y2), d(box.x1, box.y2);
  const Box2 out{carried(a, d, map).x(), carried(a, b, map).y(), carried(b, c, map).x(),
                 carried(d, c, map).y()};
  return out.x1 < out.x2 && out.y1 < out.y2 ? out : box;
}

}  // namespace

const PinholeCamera& file_camera(const Scene& scene) {
  return scene.distortion.raw.width > 0 ? scene.distortion.raw : scene.camera;
}

void take_out_lens(Scene& scene, OwnImport& out) {
  if (scene.distortion.model == LensModel::kNone) return;
  scene.camera = undistorted_camera(scene.distortion);
  const LensMap map(scene.camera, scene.distortion);
  for (SceneFrame& frame : scene.frames) {
    for (VehicleDetection& vehicle : frame.vehicles) {
      vehicle.box = carried(vehicle.box, map);
      for (KeypointObservation& keypoint : vehicle.keypoints) {
        if (!keypoint.pixel.allFinite()) continue;
        const auto pixel = map.pinhole_from_raw(keypoint.pixel);
        keypoint.pixel =
            pixel ? *pixel : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
      }
    }
  }
  out.found.push_back(
      fmt::format("the lens is taken out on reading: {} x {} pixels, cx {:.6g} cy "
                  "{:.6g}",
                  scene.camera.width, scene.camera.height, scene.camera.cx, scene.camera.cy));
}

}  // namespace camber
