#pragma once

#include <vector>

#include "camber/image/image.h"

namespace camber {

/// Texture that several images of one moving camera have in common at the same pixels: bonnet,
/// dirt and reflections on the windscreen, and asphalt that a film's coder repeats because it
/// hardly changes. It pulls whatever is matched there to standing still.
struct StillPart {
  int top = 0;                 ///< first row that was looked at
  std::vector<float> texture;  ///< intensities about their local mean, rows from `top` on
  /// Of the variance of the texture in the lower two thirds of these rows, columns of the middle
  /// half, what stands still: the median over the places. Near 0 where the camera moves and all
  /// images are what it saw, up to 1.
  double share = 0.0;
};

/// Of the mean of n images, 1 / n of the variance is by chance what moves has there; what is beyond
/// that stands still and is estimated by Wiener's filter, in places of some 31 x 11 px of an image
/// that is 1242 px wide.
/// @param images  not empty, all of one size.
/// @param top     first row, within the images.
/// @throws std::invalid_argument for other input.
StillPart still_part(const std::vector<const GrayImage*>& images, int top);

/// An image without the still part.
/// @param image  of the still part's size.
GrayImage without(const StillPart& still, const GrayImage& image);

}  // namespace camber
