#pragma once

#include <cstdint>
#include <vector>

#include "camber/scene/scene.h"

namespace camber {

/// What the pixels of one image belong to; each one byte a pixel, row-major, non-zero: yes.
struct FrameMasks {
  bool has_mask = false;                   ///< a segmentation or road mask was given
  std::vector<std::uint8_t> ground;        ///< road or pavement, clear of vehicles
  std::vector<std::uint8_t> roadway;       ///< road alone, clear of vehicles
  std::vector<std::uint8_t> ground_near;   ///< ground, vehicles and a margin of 4 px
  std::vector<std::uint8_t> vehicle;       ///< vehicles with a margin of 3 px
  std::vector<std::uint8_t> vehicle_near;  ///< vehicles and detection boxes with a margin of 4 px
};

/// Masks of a frame from its segmentation (classes of the scene) or road mask and its detections.
/// Without either everything that is not in a detection box counts as ground.
/// @throws InputError for unreadable images or images of another size.
FrameMasks make_frame_masks(const Scene& scene, const SceneFrame& frame, bool use_masks);

}  // namespace camber
