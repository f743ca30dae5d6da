#include "camber/synth/detail/crop_labels.h"

namespace camber {
namespace {

bool in_square(const Eigen::Vector2d& pixel, double low, double high) {
  return pixel.minCoeff() >= low && pixel.maxCoeff() < high;
}

}  // namespace

void label_keypoints(const CropScene& scene, const KeypointCrop& square, SynthCrop* crop) {
  const CropCamera& camera = scene.camera;
  const auto points = scene.keypoints();
  for (int k = 0; k < kNumKeypoints; ++k) {
    const Eigen::Vector3f seen = camera.project(points[k]);
    const Eigen::Vector2d pixel = seen.head<2>().cast<double>();
    crop->keypoints[k] = square.to_crop(pixel);
    const bool in_image = pixel.x() >= -0.5 && pixel.y() >= -0.5 &&
                          pixel.x() < camera.width - 0.5 && pixel.y() < camera.height - 0.5;
    const Eigen::Vector3f direction = points[k] - camera.eye;
    const float reach = 1.0f - kKeypointTolerance / direction.norm();
    if (!in_image || !in_square(crop->keypoints[k], -0.5, square.size - 0.5)) {
      crop->visibility[k] = KeypointVisibility::kOutside;
    } else if (scene.rays->blocked(0, camera.eye, direction, reach)) {
      crop->visibility[k] = KeypointVisibility::kHiddenByCar;
    } else if (scene.rays->blocked(-1, camera.eye, direction, reach)) {
      crop->visibility[k] = KeypointVisibility::kHiddenByOther;
    } else {
      crop->visibility[k] = KeypointVisibility::kVisible;
    }
  }
}

}  // namespace camber
