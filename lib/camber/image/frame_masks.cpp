#include "camber/image/frame_masks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>

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

/// Bits of the classes that a label value belongs to.
enum LabelBits : std::uint8_t { kRoad = 1, kPavement = 2, kVehicle = 4 };

std::array<std::uint8_t, 256> label_bits(const LabelClasses& classes) {
  std::array<std::uint8_t, 256> out{};
  for (const auto& [values, bit] :
       {std::pair{&classes.road, kRoad}, std::pair{&classes.pavement, kPavement},
        std::pair{&classes.vehicle, kVehicle}}) {
    for (const int value : *values) {
      if (value >= 0 && value < 256) out[static_cast<std::size_t>(value)] |= bit;
    }
  }
  return out;
}

void require_size(const Image& image, const PinholeCamera& camera) {
  if (image.channels == 1 && image.width == camera.width && image.height == camera.height) return;
  throw std::invalid_argument("label image: " + std::to_string(image.width) + " x " +
                              std::to_string(image.height) + " pixels, " +
                              std::to_string(image.channels) +
                              " channels, expected one channel of the camera's size");
}

}  // namespace

FrameMasks make_frame_masks(const PinholeCamera& camera, const MaskInputs& inputs) {
  const std::size_t total = static_cast<std::size_t>(camera.width) * camera.height;
  FrameMasks out;
  Mask boxes(total, 0), vehicle(total, 0), ground(total, 1), roadway(total, 1);
  for (const Box2& box : inputs.vehicle_boxes) fill_box(box, camera, boxes);

  const LabelClasses& classes = inputs.classes;
  if (inputs.segmentation && !(classes.road.empty() && classes.pavement.empty())) {
    require_size(*inputs.segmentation, camera);
    const std::array<std::uint8_t, 256> bits = label_bits(classes);
    for (std::size_t i = 0; i < total; ++i) {
      const std::uint8_t kind = bits[inputs.segmentation->data[i]];
      roadway[i] = (kind & kRoad) != 0;
      ground[i] = (kind & (kRoad | kPavement)) != 0;
      vehicle[i] = (kind & kVehicle) != 0;
    }
    // A segmentation without vehicles: what is in a box and not ground is one.
    if (std::find(vehicle.begin(), vehicle.end(), 1) != vehicle.end()) {
      out.vehicle_class = vehicle;
    } else {
      for (std::size_t i = 0; i < total; ++i) vehicle[i] = boxes[i] && !ground[i];
    }
    out.has_mask = true;
  } else if (inputs.road_mask) {
    require_size(*inputs.road_mask, camera);
    for (std::size_t i = 0; i < total; ++i) {
      ground[i] = roadway[i] = inputs.road_mask->data[i] != 0;
      vehicle[i] = boxes[i] && !ground[i];
    }
    out.has_mask = true;
  } else {
    vehicle = boxes;
  }

  if (!inputs.hidden.empty()) {
    if (inputs.hidden.size() != total) {
      throw std::invalid_argument("hidden: " + std::to_string(inputs.hidden.size()) +
                                  " pixels, expected " + std::to_string(total));
    }
    for (std::size_t i = 0; i < total; ++i) {
      vehicle[i] |= inputs.hidden[i];
      if (inputs.hidden[i]) ground[i] = roadway[i] = 0;
    }
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
