#pragma once

#include "camber/image/image.h"
#include "camber/synth/detail/crop_scene.h"

namespace camber {

/// The crop of the scene's detected box as RGB. Where the car is smaller than the crop the image's
/// own pixels are rendered and enlarged (detect/keypoint_crop.h), else the crop's, each as the
/// average of what it covers.
Image render_crop(const CropScene& scene, int size);

}  // namespace camber
