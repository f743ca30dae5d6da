#include "camber/image/still_part.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/image/detail/single_threaded_opencv.h"

namespace camber {
namespace {

constexpr float kNoise = 0.3F;  // intensity squared, of a place without texture: rounding and coder

/// Places: wide, since a road's texture is seen at a flat angle.
cv::Size place_of(int width) {
  const int wide = std::max(3, width / 40), high = std::max(3, width / 113);
  return {wide | 1, high | 1};
}

cv::Mat smoothed(const cv::Mat& image, const cv::Size& place) {
  cv::Mat out;
  cv::blur(image, out, place, {-1, -1}, cv::BORDER_REFLECT);
  return out;
}

}  // namespace

StillPart still_part(const std::vector<const GrayImage*>& images, int top) {
  if (images.empty() || !images.front() || top < 0 || top >= images.front()->height) {
    throw std::invalid_argument("still_part: no images, or no rows of them");
  }
  const int width = images.front()->width, height = images.front()->height;
  const SingleThreadedOpenCv guard;
  const cv::Size place = place_of(width);
  const auto count = static_cast<float>(images.size());
  const int rows = height - top;
  cv::Mat mean = cv::Mat::zeros(rows, width, CV_32FC1);
  cv::Mat power = mean.clone();
  for (const GrayImage* gray : images) {
    if (!gray || gray->width != width || gray->height != height) {
      throw std::invalid_argument("still_part: the images differ in size");
    }
    const cv::Mat image(height, width, CV_8UC1, const_cast<std::uint8_t*>(gray->pixels.data()));
    cv::Mat texture;
    image.rowRange(top, height).convertTo(texture, CV_32F);
    texture -= smoothed(texture, place);
    mean += texture / count;
    power += texture.mul(texture) / count;
  }
  StillPart out;
  out.top = top;
  out.texture.assign(static_cast<std::size_t>(rows) * static_cast<std::size_t>(width), 0.0F);
  if (images.size() < 2) return out;  // nothing moves
  const cv::Mat of_mean = smoothed(mean.mul(mean), place), of_all = smoothed(power, place);
  std::vector<float> shares;
  for (int v = 0; v < rows; ++v) {
    const auto* in_mean = of_mean.ptr<float>(v);
    const auto* in_all = of_all.ptr<float>(v);
    const auto* texture = mean.ptr<float>(v);
    float* to = &out.texture[static_cast<std::size_t>(v) * static_cast<std::size_t>(width)];
    for (int u = 0; u < width; ++u) {
      const float still = (in_mean[u] - in_all[u] / count) / (1.0F - 1.0F / count);
      to[u] = std::clamp(still / std::max(in_mean[u], kNoise), 0.0F, 1.0F) * texture[u];
      if (3 * v > rows && 4 * u > width && 4 * u < 3 * width && u % 4 == 0 && v % 4 == 0) {
        shares.push_back(still / std::max(in_all[u], kNoise));
      }
    }
  }
  if (!shares.empty()) {
    const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
    std::nth_element(shares.begin(), middle, shares.end());
    out.share = std::clamp(static_cast<double>(*middle), 0.0, 1.0);
  }
  return out;
}

GrayImage without(const StillPart& still, const GrayImage& image) {
  GrayImage out = image;
  std::uint8_t* to =
      out.pixels.data() + static_cast<std::size_t>(still.top) * static_cast<std::size_t>(out.width);
  for (std::size_t i = 0; i < still.texture.size(); ++i) {
    to[i] = static_cast<std::uint8_t>(
        std::lround(std::clamp(static_cast<float>(to[i]) - still.texture[i], 0.0F, 255.0F)));
  }
  return out;
}

}  // namespace camber
