#include "camber/image/still_share.h"

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

double still_share(const std::vector<const GrayImage*>& images, int top) {
  if (images.empty() || !images.front() || top < 0 || top >= images.front()->height) {
    throw std::invalid_argument("still_share: no images, or no rows of them");
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
      throw std::invalid_argument("still_share: the images differ in size");
    }
    const cv::Mat image(height, width, CV_8UC1, const_cast<std::uint8_t*>(gray->pixels.data()));
    cv::Mat texture;
    image.rowRange(top, height).convertTo(texture, CV_32F);
    texture -= smoothed(texture, place);
    mean += texture / count;
    power += texture.mul(texture) / count;
  }
  if (images.size() < 2) return 0.0;  // nothing moves
  const cv::Mat of_mean = smoothed(mean.mul(mean), place), of_all = smoothed(power, place);
  std::vector<float> shares;
  for (int v = rows / 3 + 1; v < rows; ++v) {
    if (v % 4 != 0) continue;
    for (int u = width / 4 + 1; 4 * u < 3 * width; ++u) {
      if (u % 4 != 0) continue;
      const float in_all = of_all.at<float>(v, u);
      const float still = (of_mean.at<float>(v, u) - in_all / count) / (1.0F - 1.0F / count);
      shares.push_back(still / std::max(in_all, kNoise));
    }
  }
  if (shares.empty()) return 0.0;
  const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::nth_element(shares.begin(), middle, shares.end());
  return std::clamp(static_cast<double>(*middle), 0.0, 1.0);
}

}  // namespace camber
