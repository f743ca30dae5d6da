#pragma once

#include <limits>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image_io.h"

namespace camber {

/// The known pixels of a depth image as points in the camera's frame, row by row; the scalar
/// attributes of a pixel come along where images of the same size are given.
/// @param color     3 channels, or nullptr
/// @param labels    1 channel, into labels["class"], or nullptr
/// @param largest   m along z; pixels farther away are left out
/// @throws std::invalid_argument if a size differs from the camera's.
RoadCloud cloud_from_depth(const DepthImage& depth, const PinholeCamera& camera,
                           const Image* color = nullptr, const Image* labels = nullptr,
                           double largest = std::numeric_limits<double>::infinity());

}  // namespace camber
