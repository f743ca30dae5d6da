#include "pipeline/half_scene.h"

#include <string>

#include "camber/image/image_io.h"

namespace camber::test {
namespace {

/// Every second pixel, or the mean of 2 x 2.
Image halved(const Image& image, bool averaged) {
  Image out{image.width / 2, image.height / 2, image.channels, {}};
  for (int y = 0; y < out.height; ++y) {
    const std::uint8_t *upper = image.row(2 * y), *lower = image.row(2 * y + 1);
    for (int x = 0; x < out.width; ++x) {
      for (int c = 0; c < image.channels; ++c) {
        const int left = 2 * x * image.channels + c, right = left + image.channels;
        const int sum = upper[left] + upper[right] + lower[left] + lower[right];
        out.data.push_back(averaged ? static_cast<std::uint8_t>((sum + 2) / 4) : upper[left]);
      }
    }
  }
  return out;
}

// Pixel centres are integers: that of the half image's first pixel is 0.5 in the whole one.
double halved(double pixel) { return 0.5 * (pixel - 0.5); }

Box2 halved(const Box2& box) {
  return {halved(box.x1), halved(box.y1), halved(box.x2), halved(box.y2)};
}

}  // namespace

Scene half_size(const Scene& scene, const std::filesystem::path& folder) {
  Scene out = scene;
  out.camera.width /= 2;
  out.camera.height /= 2;
  out.camera.fx /= 2.0;
  out.camera.fy /= 2.0;
  out.camera.cx = halved(scene.camera.cx);
  out.camera.cy = halved(scene.camera.cy);
  for (SceneFrame& frame : out.frames) {
    const Image labels = read_label_image(frame.segmentation, scene.camera);
    const std::string id = std::to_string(frame.id);
    const Image image = halved(read_color_image(frame.image), true);
    frame.image = folder / (id + ".png");
    frame.segmentation = folder / (id + "_labels.png");
    write_png(image, frame.image);
    write_png(halved(labels, false), frame.segmentation);
    for (VehicleDetection& vehicle : frame.vehicles) {
      vehicle.box = halved(vehicle.box);
      for (KeypointObservation& keypoint : vehicle.keypoints) {
        keypoint.pixel = {halved(keypoint.pixel.x()), halved(keypoint.pixel.y())};
      }
    }
  }
  if (!out.truth) return out;
  for (TruthFrame& frame : out.truth->frames) {
    frame.depth.clear();
    frame.label.clear();
    for (TruthVehicle& vehicle : frame.vehicles) vehicle.box = halved(vehicle.box);
  }
  return out;
}

}  // namespace camber::test
