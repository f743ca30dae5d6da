#include "camber/image/undistortion.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/geometry/lens_map.h"
#include "camber/image/detail/single_threaded_opencv.h"

namespace camber {
namespace {

bool same(const PinholeCamera& a, const PinholeCamera& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
         a.cx == b.cx && a.cy == b.cy;
}

}  // namespace

Undistortion::Undistortion(const PinholeCamera& camera) : camera_(camera), raw_(camera) {}

Undistortion::Undistortion(const PinholeCamera& camera, const LensDistortion& lens)
    : Undistortion(camera) {
  // A scene without a lens has no raw camera.
  if (lens.model == LensModel::kNone && (lens.raw.width == 0 || same(lens.raw, camera))) return;
  constexpr float kOutside = -1e4F;
  constexpr int kMargin = 3;  // px, windows that compare images must not see the border
  raw_ = lens.raw;
  const LensMap map(camera, lens);
  const auto count =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  x_.assign(count, kOutside);
  y_.assign(count, kOutside);
  outside_.assign(count, 1);
  std::size_t at = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u, ++at) {
      const auto pixel = map.raw_from_pinhole({u, v});
      if (!pixel || !raw_.contains(*pixel, -0.5)) continue;
      x_[at] = static_cast<float>(pixel->x());
      y_[at] = static_cast<float>(pixel->y());
      outside_[at] = 0;
    }
  }
  cv::Mat mask(camera.height, camera.width, CV_8UC1, outside_.data());
  const SingleThreadedOpenCv guard;
  cv::dilate(mask.clone(), mask,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kMargin + 1, 2 * kMargin + 1}));
}

Image Undistortion::remapped(const Image& file, int interpolation) const {
  if (!needed()) return file;
  if (file.width != raw_.width || file.height != raw_.height) {
    throw std::invalid_argument(
        fmt::format("undistortion: an image of {} x {} pixels, expected {} x {}", file.width,
                    file.height, raw_.width, raw_.height));
  }
  Image out{camera_.width, camera_.height, file.channels, {}};
  out.data.resize(x_.size() * static_cast<std::size_t>(file.channels));
  const int type = CV_8UC(file.channels);
  const cv::Mat from(file.height, file.width, type, const_cast<std::uint8_t*>(file.data.data()));
  cv::Mat to(out.height, out.width, type, out.data.data());
  const cv::Mat x(out.height, out.width, CV_32FC1, const_cast<float*>(x_.data()));
  const cv::Mat y(out.height, out.width, CV_32FC1, const_cast<float*>(y_.data()));
  const SingleThreadedOpenCv guard;
  // Rows and columns beyond the file's border by half a pixel repeat it.
  cv::remap(from, to, x, y, interpolation, cv::BORDER_REPLICATE);
  for (std::size_t i = 0; i < x_.size(); ++i) {
    if (x_[i] > -1e3F) continue;
    for (int c = 0; c < file.channels; ++c) {
      out.data[i * static_cast<std::size_t>(file.channels) + static_cast<std::size_t>(c)] = 0;
    }
  }
  return out;
}

Image Undistortion::image(const Image& file) const { return remapped(file, cv::INTER_CUBIC); }
Image Undistortion::labels(const Image& file) const { return remapped(file, cv::INTER_NEAREST); }

}  // namespace camber
