#pragma once

#include <Eigen/Core>

#include "camber/geometry/box.h"
#include "camber/image/image.h"

namespace camber {

/// px, sides of the crop in which keypoints are stated; a network may take twice as many pixels of
/// it.
constexpr int kKeypointCropSize = 64;
/// Side of the crop over the larger side of the box.
constexpr double kKeypointCropMargin = 1.15;
/// Of 0 to 255, all channels: what lies outside the image.
constexpr int kKeypointCropPadding = 114;

/// A square part of an image, resampled to size x size pixels. Pixel centres lie at whole numbers
/// in the image and in the crop: crop point (i, j) is the image point center + ((i + 1/2, j + 1/2)
/// / size - 1/2) * side.
struct KeypointCrop {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();  ///< px of the image
  double side = 0.0;                                 ///< px of the image, > 0
  int size = kKeypointCropSize;                      ///< px of the crop, > 0

  /// px of the image for one of the crop.
  double scale() const { return side / size; }
  Eigen::Vector2d to_image(const Eigen::Vector2d& in_crop) const {
    return center + (((in_crop.array() + 0.5) / size - 0.5) * side).matrix();
  }
  Eigen::Vector2d to_crop(const Eigen::Vector2d& in_image) const {
    return (((in_image - center).array() / side + 0.5) * size - 0.5).matrix();
  }
};

/// The crop of a vehicle's box: centred on it, kKeypointCropMargin times its larger side.
/// @throws std::invalid_argument for a box that is not finite or has no extent, or a size < 1.
KeypointCrop keypoint_crop(const Box2& box, int size = kKeypointCropSize);

/// The pixels of a crop: an average over each crop pixel's area where the crop is the smaller one,
/// bilinear where it is the larger one; kKeypointCropPadding outside the image. Same channels as
/// the image. The same numbers on any number of threads.
/// @throws std::invalid_argument for an empty image.
Image cut_crop(const Image& image, const KeypointCrop& crop);

}  // namespace camber
