#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "camber/image/image.h"

namespace camber {

/// Structure tensor of an image: means of gx^2, gx gy and gy^2 over windows of 9 x 9 pixels,
/// (intensity / pixel)^2.
class StructureTensor {
 public:
  StructureTensor() = default;
  explicit StructureTensor(const GrayImage& image);

  /// At the pixel that holds a place in the image.
  Eigen::Vector3f at(const Eigen::Vector2f& place) const {
    const int x = static_cast<int>(place.x()), y = static_cast<int>(place.y());
    return {xx_.at<float>(y, x), xy_.at<float>(y, x), yy_.at<float>(y, x)};
  }

 private:
  cv::Mat xx_, xy_, yy_;
};

}  // namespace camber
