#pragma once

#include <cstdint>
#include <set>
#include <vector>

#include "camber/image/image.h"

namespace camber {

/// The pixels of one vehicle in a label image.
struct VehicleRegion {
  int class_id = 0;
  int instance = -1;        ///< its number in the label image; -1: found by depth
  std::vector<int> pixels;  ///< ascending indices, row * width + column; all with known depth
};

/// Parts a label image into vehicles. With `instances` (a number a pixel) pixels of one class and
/// number are a vehicle. Without, neighbouring pixels of one class are where their depths differ by
/// less than 0.4 m or 3 %; a part that a step inside the vehicle cuts off (a bonnet behind a wing)
/// joins its neighbour if it is less than a third of it and its middle within 3 m.
/// @param classes    1 channel, of the depth image's size
/// @param instances  one a pixel, or empty
/// @param smallest   regions of fewer pixels are left out
/// @return by number, or in the order of their first pixels.
std::vector<VehicleRegion> vehicle_regions(const DepthImage& depth, const Image& classes,
                                           const std::vector<std::uint16_t>& instances,
                                           const std::set<int>& vehicle_classes,
                                           std::size_t smallest = 60);

}  // namespace camber
