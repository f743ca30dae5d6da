#pragma once

#include <vector>

#include "camber/motion/correspondences.h"

namespace camber {

/// One channel of floats, rows from the top, no padding.
struct FloatImage {
  int width = 0, height = 0;
  std::vector<float> pixels;
};

/// A grey image with its low frequencies and its local contrast taken out, so that shading,
/// exposure and vignetting cancel between frames, with its derivatives.
struct PhotometricImage {
  FloatImage value;       ///< dimensionless, about -3 to 3
  FloatImage gradient_x;  ///< per pixel
  FloatImage gradient_y;  ///< per pixel
};

/// @param blur_px     standard deviation of the Gaussian smoothing, >= 0.3.
/// @param window_px   standard deviation of the Gaussian window whose mean and contrast are taken
///                    out, > blur_px.
PhotometricImage make_photometric_image(const GrayImage& image, double blur_px, double window_px);

}  // namespace camber
