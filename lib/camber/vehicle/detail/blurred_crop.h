#pragma once

#include <vector>

#include "camber/geometry/box.h"
#include "camber/motion/correspondences.h"

namespace camber::internal {

/// A part of an image, blurred.
struct BlurredCrop {
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::vector<float> values;  ///< intensities, rows from the top; empty: outside the image

  /// Whether value() is defined at p and one pixel around it.
  bool contains(const Eigen::Vector2d& p) const {
    return p.x() >= x0 + 1 && p.y() >= y0 + 1 && p.x() < x0 + width - 2 && p.y() < y0 + height - 2;
  }
  double value(const Eigen::Vector2d& p) const {  ///< bilinear
    const double x = p.x() - x0, y = p.y() - y0;
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    const double a = x - i, b = y - j;
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
  }

 private:
  float at(int x, int y) const {
    return values[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
};

/// @param sigma  px, of a Gaussian.
BlurredCrop blurred_crop(const GrayImage& image, const Box2& box, double sigma);

}  // namespace camber::internal
