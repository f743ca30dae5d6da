#include "camber/render/picture_file.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height) + " pixels";
}

}  // namespace

Image make_picture(int width, int height, std::uint8_t grey) {
  if (width < 1 || height < 1 || width > 65535 || height > 65535) {
    throw std::invalid_argument("picture size: found " + size_text(width, height) +
                                ", expected 1 to 65535 each");
  }
  Image picture;
  picture.width = width;
  picture.height = height;
  picture.channels = 3;
  picture.data.assign(3 * static_cast<std::size_t>(width) * height, grey);
  return picture;
}

Image shrink_picture(const Image& picture, int width) {
  require_picture(picture, "picture");
  if (width < 1 || width > picture.width) {
    throw std::invalid_argument("picture width: found " + std::to_string(width) +
                                ", expected 1 to " + std::to_string(picture.width));
  }
  const double factor = static_cast<double>(width) / picture.width;
  Image out =
      make_picture(width, std::max(1, static_cast<int>(std::lround(picture.height * factor))), 0);
  const cv::Mat from(picture.height, picture.width, CV_8UC3,
                     const_cast<std::uint8_t*>(picture.data.data()));
  cv::Mat to(out.height, out.width, CV_8UC3, out.data.data());
  cv::resize(from, to, to.size(), 0, 0, cv::INTER_AREA);
  return out;
}

void require_picture(const Image& picture, const char* name) {
  if (picture.width < 1 || picture.height < 1) {
    throw std::invalid_argument(std::string(name) + ": found " +
                                size_text(picture.width, picture.height) +
                                ", expected at least 1 x 1");
  }
  const std::size_t expected = 3 * static_cast<std::size_t>(picture.width) * picture.height;
  if (picture.channels != 3 || picture.data.size() != expected) {
    throw std::invalid_argument(
        std::string(name) + " of " + size_text(picture.width, picture.height) + ": found " +
        std::to_string(picture.channels) + " channels and " + std::to_string(picture.data.size()) +
        " bytes, expected 3 channels and " + std::to_string(expected));
  }
}

}  // namespace camber
