#include "camber/detect/keypoint_crop.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace camber {
namespace {

/// The pixels of an image's row (or column) that make one pixel of the crop.
struct Taps {
  int first = 0;
  std::vector<float> weights;  ///< of `first` and those after it; less than 1 in sum at the border
};

/// The taps of every pixel along one axis.
/// @param length  of the image along it, px.
std::vector<Taps> taps_of(const KeypointCrop& crop, double center, int length) {
  const double scale = crop.scale();
  // A triangle of one pixel is bilinear interpolation, a box of the crop pixel's width is the
  // average over its area.
  const bool average = scale > 1.0;
  const double reach = average ? 0.5 * scale + 0.5 : 1.0;
  std::vector<Taps> out(static_cast<std::size_t>(crop.size));
  for (int i = 0; i < crop.size; ++i) {
    const double at = center + ((i + 0.5) / crop.size - 0.5) * crop.side;
    const double low = std::clamp(std::ceil(at - reach), 0.0, static_cast<double>(length));
    const double high = std::clamp(std::floor(at + reach), -1.0, length - 1.0);
    Taps& taps = out[static_cast<std::size_t>(i)];
    taps.first = static_cast<int>(low);
    for (int k = taps.first; k <= static_cast<int>(high); ++k) {
      const double overlap =
          std::min(k + 0.5, at + 0.5 * scale) - std::max(k - 0.5, at - 0.5 * scale);
      const double weight = average ? overlap / scale : 1.0 - std::abs(k - at);
      taps.weights.push_back(static_cast<float>(std::max(0.0, weight)));
    }
  }
  return out;
}

}  // namespace

KeypointCrop keypoint_crop(const Box2& box, int size) {
  const double side = kKeypointCropMargin * std::max(box.width(), box.height());
  if (!(side > 0.0) || !std::isfinite(side) || !box.center().allFinite() || size < 1) {
    throw std::invalid_argument(
        fmt::format("keypoint crop of the box {} {} {} {} and size {}: must be finite, of some "
                    "extent, and > 0",
                    box.x1, box.y1, box.x2, box.y2, size));
  }
  return {box.center(), side, size};
}

Image cut_crop(const Image& image, const KeypointCrop& crop) {
  if (image.empty()) throw std::invalid_argument("cut_crop: the image is empty");
  const std::vector<Taps> across = taps_of(crop, crop.center.x(), image.width);
  const std::vector<Taps> down = taps_of(crop, crop.center.y(), image.height);
  const int channels = image.channels;
  const std::size_t row_size = static_cast<std::size_t>(crop.size) * channels;
  Image out{crop.size, crop.size, channels, {}};
  out.data.reserve(row_size * crop.size);
  // Differences from the padding: what lies outside the image adds nothing.
  std::vector<float> row(row_size), sum(row_size);
  for (const Taps& rows : down) {
    std::fill(sum.begin(), sum.end(), 0.0F);
    for (std::size_t r = 0; r < rows.weights.size(); ++r) {
      const std::uint8_t* from = image.row(rows.first + static_cast<int>(r));
      for (std::size_t i = 0; i < across.size(); ++i) {
        const std::uint8_t* pixel = from + static_cast<std::size_t>(across[i].first) * channels;
        for (int c = 0; c < channels; ++c) {
          float value = 0.0F;
          for (std::size_t k = 0; k < across[i].weights.size(); ++k) {
            value += across[i].weights[k] *
                     static_cast<float>(pixel[k * channels + c] - kKeypointCropPadding);
          }
          row[i * channels + c] = value;
        }
      }
      for (std::size_t i = 0; i < row_size; ++i) sum[i] += rows.weights[r] * row[i];
    }
    for (const float value : sum) {
      const float whole = std::floor(value + kKeypointCropPadding + 0.5F);
      out.data.push_back(static_cast<std::uint8_t>(std::clamp(whole, 0.0F, 255.0F)));
    }
  }
  return out;
}

}  // namespace camber
