#pragma once

#include <vector>

#include "camber/image/image.h"

namespace camber {

/// Of the variance of the texture in the lower two thirds of the rows from `top` on, columns of the
/// middle half, what stands still in several images of one moving camera: the median over places of
/// some 31 x 11 px of an image that is 1242 px wide. Near 0 where all images are what the camera
/// saw; up to 1 where a film's coder repeats asphalt because it hardly changes, which pulls
/// whatever is matched there to standing still. Of the mean of n images 1 / n of the variance is by
/// chance what moves has there, and is not counted.
/// @param images  not empty, all of one size; of one image: 0.
/// @param top     first row, within the images.
/// @throws std::invalid_argument for other input.
double still_share(const std::vector<const GrayImage*>& images, int top);

}  // namespace camber
