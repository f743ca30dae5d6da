#include "camber/image/raw_pixels.h"

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>

namespace camber {
namespace {

/// How an encoding is brought to grey or to red, green, blue.
struct Encoding {
  int type;        // of OpenCV
  int conversion;  // of cv::cvtColor; -1: none
  int multiple;    // width and height must be multiples: the cells of a pattern
};

const std::map<std::string, Encoding>& encodings() {
  // OpenCV names Bayer patterns by the second row's second and third pixel.
  static const std::map<std::string, Encoding> table = {
      {"mono8", {CV_8UC1, -1, 1}},
      {"8UC1", {CV_8UC1, -1, 1}},
      {"rgb8", {CV_8UC3, -1, 1}},
      {"bgr8", {CV_8UC3, cv::COLOR_BGR2RGB, 1}},
      {"8UC3", {CV_8UC3, cv::COLOR_BGR2RGB, 1}},
      {"rgba8", {CV_8UC4, cv::COLOR_RGBA2RGB, 1}},
      {"bgra8", {CV_8UC4, cv::COLOR_BGRA2RGB, 1}},
      {"8UC4", {CV_8UC4, cv::COLOR_BGRA2RGB, 1}},
      {"bayer_rggb8", {CV_8UC1, cv::COLOR_BayerBG2RGB, 2}},
      {"bayer_bggr8", {CV_8UC1, cv::COLOR_BayerRG2RGB, 2}},
      {"bayer_gbrg8", {CV_8UC1, cv::COLOR_BayerGR2RGB, 2}},
      {"bayer_grbg8", {CV_8UC1, cv::COLOR_BayerGB2RGB, 2}},
      {"uyvy", {CV_8UC2, cv::COLOR_YUV2RGB_UYVY, 2}},
      {"yuyv", {CV_8UC2, cv::COLOR_YUV2RGB_YUY2, 2}},
      {"yuv422", {CV_8UC2, cv::COLOR_YUV2RGB_UYVY, 2}},
      {"yuv422_yuy2", {CV_8UC2, cv::COLOR_YUV2RGB_YUY2, 2}}};
  return table;
}

/// The upper bytes of grey of 16 bits; nothing where the lower 12 hold all, which would leave few
/// grey levels.
std::optional<Image> upper_bytes(const RawPixels& raw) {
  if (raw.step < 2 * static_cast<std::size_t>(raw.width)) return std::nullopt;
  Image out{raw.width, raw.height, 1, {}};
  out.data.resize(static_cast<std::size_t>(raw.width) * static_cast<std::size_t>(raw.height));
  int greatest = 0;
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    const std::size_t row = i / static_cast<std::size_t>(raw.width),
                      column = i % static_cast<std::size_t>(raw.width);
    out.data[i] = raw.data[row * raw.step + 2 * column + (raw.big_endian ? 0 : 1)];
    greatest = std::max<int>(greatest, out.data[i]);
  }
  constexpr int kLower = 16;  // 12 bits
  if (greatest < kLower) return std::nullopt;
  return out;
}

}  // namespace

const char* raw_pixel_encodings() {
  return "mono8, mono16 (all 16 bits), rgb8, bgr8, rgba8, bgra8, bayer_*8, uyvy or yuyv";
}

std::optional<Image> decode_raw_pixels(const RawPixels& raw) {
  const bool sized = raw.width >= 1 && raw.height >= 1;
  if (sized && (raw.encoding == "mono16" || raw.encoding == "16UC1")) return upper_bytes(raw);
  const auto at = encodings().find(raw.encoding);
  if (at == encodings().end() || raw.width < 1 || raw.height < 1) return std::nullopt;
  const Encoding& encoding = at->second;
  if (raw.step < static_cast<std::size_t>(raw.width) * CV_ELEM_SIZE(encoding.type)) {
    return std::nullopt;
  }
  // Bilinear interpolation needs a cell on either side.
  if (encoding.multiple > 1 &&
      (raw.width % 2 != 0 || raw.height % 2 != 0 || raw.width < 4 || raw.height < 4)) {
    return std::nullopt;
  }
  // Read only: OpenCV has no matrix of constant pixels.
  const cv::Mat from(raw.height, raw.width, encoding.type, const_cast<std::uint8_t*>(raw.data),
                     raw.step);
  cv::Mat pixels;
  if (encoding.conversion < 0) {
    pixels = from.clone();
  } else {
    cv::cvtColor(from, pixels, encoding.conversion);
  }
  return Image{raw.width, raw.height, pixels.channels(),
               std::vector<std::uint8_t>(pixels.datastart, pixels.dataend)};
}

}  // namespace camber
