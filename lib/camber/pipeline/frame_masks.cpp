#include "camber/pipeline/frame_masks.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "camber/scene/image_io.h"

namespace camber {
namespace {

using Mask = std::vector<std::uint8_t>;

Mask grown(const Mask& mask, const PinholeCamera& camera, int margin) {
  const cv::Mat in(camera.height, camera.width, CV_8UC1, const_cast<std::uint8_t*>(mask.data()));
  Mask out(mask.size());
  cv::Mat result(camera.height, camera.width, CV_8UC1, out.data());
  cv::dilate(in, result,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * margin + 1, 2 * margin + 1}));
  return out;
}

void fill_box(const Box2& box, const PinholeCamera& camera, Mask& mask) {
  const int x1 = std::clamp(static_cast<int>(std::floor(box.x1)), 0, camera.width);
  const int x2 = std::clamp(static_cast<int>(std::ceil(box.x2)) + 1, x1, camera.width);
  const int y1 = std::clamp(static_cast<int>(std::floor(box.y1)), 0, camera.height);
  const int y2 = std::clamp(static_cast<int>(std::ceil(box.y2)) + 1, y1, camera.height);
  for (int y = y1; y < y2; ++y) {
    std::fill(mask.begin() + y * camera.width + x1, mask.begin() + y * camera.width + x2,
              std::uint8_t{1});
  }
}

}  // namespace

FrameMasks make_frame_masks(const Scene& scene, const SceneFrame& frame, bool use_masks) {
  const PinholeCamera& camera = scene.camera;
  const std::size_t total = static_cast<std::size_t>(camera.width) * camera.height;
  FrameMasks out;
  Mask boxes(total, 0), vehicle(total, 0), ground(total, 1), roadway(total, 1);
  for (const VehicleDetection& detection : frame.vehicles) fill_box(detection.box, camera, boxes);

  const auto has = [&](const char* name) {
    const auto found = scene.segmentation_classes.find(name);
    return found != scene.segmentation_classes.end() && !found->second.empty();
  };
  if (use_masks && !frame.segmentation.empty() && (has("road") || has("pavement"))) {
    const Image labels = read_label_image(frame.segmentation, camera);
    std::uint8_t kinds[256] = {};
    const auto mark = [&](const char* name, std::uint8_t bit) {
      const auto found = scene.segmentation_classes.find(name);
      if (found == scene.segmentation_classes.end()) return;
      for (const int value : found->second) {
        if (value >= 0 && value < 256) kinds[value] |= bit;
      }
    };
    mark("road", 1);
    mark("pavement", 2);
    mark("vehicle", 4);
    for (std::size_t i = 0; i < total; ++i) {
      const std::uint8_t kind = kinds[labels.data[i]];
      roadway[i] = kind & 1;
      ground[i] = (kind & 3) != 0;
      vehicle[i] = (kind & 4) != 0;
    }
    // Classes without vehicles: what is in a box and not ground is one.
    if (!has("vehicle")) {
      for (std::size_t i = 0; i < total; ++i) vehicle[i] = boxes[i] && !ground[i];
    }
    out.has_mask = true;
  } else if (use_masks && !frame.road_mask.empty()) {
    const Image mask = read_label_image(frame.road_mask, camera);
    for (std::size_t i = 0; i < total; ++i) {
      ground[i] = roadway[i] = mask.data[i] != 0;
      vehicle[i] = boxes[i] && !ground[i];
    }
    out.has_mask = true;
  } else {
    vehicle = boxes;
  }

  out.vehicle = grown(vehicle, camera, 3);
  Mask both(total);
  for (std::size_t i = 0; i < total; ++i) both[i] = vehicle[i] || boxes[i];
  out.vehicle_near = grown(both, camera, 4);
  for (std::size_t i = 0; i < total; ++i) both[i] = ground[i] || vehicle[i];
  out.ground_near = grown(both, camera, 4);
  for (std::size_t i = 0; i < total; ++i) {
    if (out.vehicle[i]) ground[i] = roadway[i] = 0;
  }
  out.ground = std::move(ground);
  out.roadway = std::move(roadway);
  return out;
}

}  // namespace camber
