#include "camber/photometric/photometric_image.h"

#include <opencv2/imgproc.hpp>

namespace camber {
namespace {

FloatImage from_mat(const cv::Mat& mat) {
  FloatImage out;
  out.width = mat.cols;
  out.height = mat.rows;
  out.pixels.assign(mat.ptr<float>(), mat.ptr<float>() + mat.total());
  return out;
}

/// Gaussian window by three box filters (central limit), whatever its width at the same cost.
void wide_blur(const cv::Mat& in, cv::Mat* out, double sigma) {
  const int side = 2 * static_cast<int>(std::lround(std::sqrt(sigma * sigma * 12.0 / 2.0 + 1.0) / 2)) + 1;
  cv::boxFilter(in, *out, CV_32F, cv::Size(side, side));
  cv::boxFilter(*out, *out, CV_32F, cv::Size(side, side));
}

}  // namespace

PhotometricImage make_photometric_image(const GrayImage& image, double blur_px, double window_px) {
  const cv::Mat grey(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  cv::Mat smooth;
  grey.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, cv::Size(), blur_px);
  cv::Mat mean, deviation, contrast;
  wide_blur(smooth, &mean, window_px);
  deviation = smooth - mean;
  wide_blur(deviation.mul(deviation), &contrast, 1.5 * window_px);
  cv::sqrt(contrast, contrast);
  constexpr double kLeastContrast = 0.7;  // grey values: keeps noise from being blown up
  cv::divide(deviation, contrast + kLeastContrast, deviation);
  PhotometricImage out;
  cv::Mat gx, gy;
  // Central differences.
  const cv::Mat row = (cv::Mat_<float>(1, 3) << -0.5f, 0.0f, 0.5f);
  cv::filter2D(deviation, gx, CV_32F, row);
  cv::filter2D(deviation, gy, CV_32F, row.t());
  out.value = from_mat(deviation);
  out.gradient_x = from_mat(gx);
  out.gradient_y = from_mat(gy);
  return out;
}

}  // namespace camber
