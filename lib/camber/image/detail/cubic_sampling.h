#pragma once

#include <cstddef>

namespace camber::detail {

/// An image of floats; rows `pitch` apart.
struct FloatImage {
  const float* pixels = nullptr;
  std::ptrdiff_t pitch = 0;
  int width = 0, height = 0;  ///< at least 1
};

/// Values between pixels by cubic convolution (Keys, "Cubic Convolution Interpolation", 1981), at
/// exact places; the rim is repeated for the pixels around a place that the image does not hold.
/// @param sharpness  the convolution's free parameter: -0.5 reproduces planes, -0.75 (OpenCV's)
///                   keeps more of fine texture.
/// @param x, y       `count` places, px.
/// @param outside    values where the place lies outside the image or is NaN, one a place.
void sample_cubic(const FloatImage& image, float sharpness, int count, const float* x,
                  const float* y, const float* outside, float* out);

}  // namespace camber::detail
