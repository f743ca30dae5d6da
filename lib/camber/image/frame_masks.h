#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// Label values of a segmentation by class; values outside [0, 255] never occur.
struct LabelClasses {
  std::vector<int> road, pavement, vehicle;
};

/// What is known of one image's pixels before any geometry.
struct MaskInputs {
  std::vector<Box2> vehicle_boxes;    ///< px
  std::optional<Image> segmentation;  ///< one channel, read through `classes`
  LabelClasses classes;
  std::optional<Image> road_mask;  ///< one channel, non-zero: road; used without a segmentation
  /// One byte a pixel, or empty: non-zero where the image shows nothing; counts as a vehicle does.
  std::vector<std::uint8_t> hidden;
};

/// What the pixels of one image belong to; each one byte a pixel, row-major, non-zero: yes.
struct FrameMasks {
  bool has_mask = false;                   ///< a segmentation or road mask was given
  std::vector<std::uint8_t> ground;        ///< road or pavement, clear of vehicles
  std::vector<std::uint8_t> roadway;       ///< road alone, clear of vehicles
  std::vector<std::uint8_t> ground_near;   ///< ground, vehicles and a margin of 4 px
  std::vector<std::uint8_t> vehicle;       ///< vehicles with a margin of 3 px
  std::vector<std::uint8_t> vehicle_near;  ///< vehicles and detection boxes with a margin of 4 px
  /// Vehicles as the segmentation has them, without a margin; empty where it shows none.
  std::vector<std::uint8_t> vehicle_class;
};

/// Masks of a frame from its segmentation or road mask and its detections. Without either
/// everything that is not in a detection box counts as ground.
/// @throws std::invalid_argument for label images that do not have the camera's size.
FrameMasks make_frame_masks(const PinholeCamera& camera, const MaskInputs& inputs);

}  // namespace camber
