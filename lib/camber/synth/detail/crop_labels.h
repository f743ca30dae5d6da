#pragma once

#include "camber/detect/keypoint_crop.h"
#include "camber/synth/detail/crop_scene.h"
#include "camber/synth/keypoint_crops.h"

namespace camber {

/// How far before a keypoint something must be to hide it, m: a keypoint lies on the surface, at an
/// edge of it.
inline constexpr float kKeypointTolerance = 0.06f;

/// Sets the keypoints of the scene's car in the square, and what hides them.
void label_keypoints(const CropScene& scene, const KeypointCrop& square, SynthCrop* crop);

}  // namespace camber
