#include "camber/vehicle/detail/blurred_crop.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace camber::internal {

BlurredCrop blurred_crop(const GrayImage& image, const Box2& box, double sigma) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma));
  BlurredCrop out;
  out.x0 = std::max(0, static_cast<int>(box.x1));
  out.y0 = std::max(0, static_cast<int>(box.y1));
  out.width = std::min(image.width, static_cast<int>(box.x2) + 1) - out.x0;
  out.height = std::min(image.height, static_cast<int>(box.y2) + 1) - out.y0;
  if (out.width <= 0 || out.height <= 0) return BlurredCrop{};
  std::vector<float> kernel(static_cast<std::size_t>(2 * reach + 1));
  float total = 0.0F;
  for (int i = -reach; i <= reach; ++i) {
    kernel[static_cast<std::size_t>(i + reach)] =
        static_cast<float>(std::exp(-0.5 * i * i / (sigma * sigma)));
    total += kernel[static_cast<std::size_t>(i + reach)];
  }
  for (float& k : kernel) k /= total;
  const int rows = out.height + 2 * reach;
  const auto width = static_cast<std::size_t>(out.width);
  std::vector<float> across(width * static_cast<std::size_t>(rows));
  for (int y = 0; y < rows; ++y) {
    const std::uint8_t* row = image.row(std::clamp(out.y0 + y - reach, 0, image.height - 1));
    for (int x = 0; x < out.width; ++x) {
      float sum = 0.0F;
      for (int i = -reach; i <= reach; ++i) {
        sum += kernel[static_cast<std::size_t>(i + reach)] *
               static_cast<float>(row[std::clamp(out.x0 + x + i, 0, image.width - 1)]);
      }
      across[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] = sum;
    }
  }
  out.values.assign(width * static_cast<std::size_t>(out.height), 0.0F);
  for (int y = 0; y < out.height; ++y) {
    for (int i = 0; i <= 2 * reach; ++i) {
      const float k = kernel[static_cast<std::size_t>(i)];
      const float* from = &across[static_cast<std::size_t>(y + i) * width];
      float* to = &out.values[static_cast<std::size_t>(y) * width];
      for (std::size_t x = 0; x < width; ++x) to[x] += k * from[x];
    }
  }
  return out;
}

}  // namespace camber::internal
