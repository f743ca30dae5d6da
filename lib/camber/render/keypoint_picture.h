#pragma once

#include "camber/image/image_io.h"
#include "camber/vehicle/shape_prior.h"

namespace camber {

/// The mean shape of a prior with its numbered keypoints: seen from the left, with the numbers of
/// that side (row i + 18 mirrors row i), and obliquely from the front, with those of the right.
Image draw_keypoint_picture(const ShapePrior& prior);

}  // namespace camber
