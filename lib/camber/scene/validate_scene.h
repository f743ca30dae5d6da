#pragma once

#include "camber/scene/scene.h"

namespace camber {

constexpr double kMostCameraHeight = 1000.0;  ///< m above the road

/// Holds a scene that a program makes to what read_scene() holds a manifest to. The truth is not
/// looked at, there may be no frames yet, and keypoints that are not seen may have pixels of NaN.
/// @throws std::invalid_argument naming the frame and the first field that cannot be.
void validate(const Scene& scene);
void validate(const SceneFrame& frame);
void validate_camera_height(double height_above_road);

}  // namespace camber
