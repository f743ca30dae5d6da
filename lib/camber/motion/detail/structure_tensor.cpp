#include "camber/motion/detail/structure_tensor.h"

#include <opencv2/imgproc.hpp>

namespace camber {

StructureTensor::StructureTensor(const GrayImage& image) {
  const cv::Mat view(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  cv::Mat gx, gy;
  cv::Sobel(view, gx, CV_32F, 1, 0, 3, 1.0 / 8);
  cv::Sobel(view, gy, CV_32F, 0, 1, 3, 1.0 / 8);
  const cv::Size window(9, 9);
  cv::boxFilter(gx.mul(gx), xx_, -1, window);
  cv::boxFilter(gx.mul(gy), xy_, -1, window);
  cv::boxFilter(gy.mul(gy), yy_, -1, window);
}

}  // namespace camber
