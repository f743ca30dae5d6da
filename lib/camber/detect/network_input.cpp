#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/core/read_file.h"
#include "camber/detect/network.h"

namespace camber {

std::string Tensor::describe() const { return fmt::format("({})", fmt::join(shape, ", ")); }

std::string describe(const std::vector<Tensor>& outputs) {
  std::vector<std::string> parts;
  for (const Tensor& output : outputs) {
    parts.push_back(output.describe() + (outputs.size() > 1 ? " " + output.name : ""));
  }
  return fmt::format("output {}", fmt::join(parts, " and "));
}

OnnxFile read_onnx_file(const std::filesystem::path& path) {
  return {path.string(), read_whole_file(path)};
}

InputPlacement place_in_input(const NetworkInput& input, const ImagePart& part) {
  InputPlacement out;
  out.part = part;
  out.scale_x = static_cast<double>(input.width) / part.width;
  out.scale_y = static_cast<double>(input.height) / part.height;
  if (input.fit == NetworkInput::Fit::kStretch) return out;
  // As detectors are trained: the resized part has whole pixels, one factor for both axes.
  const double scale = std::min(out.scale_x, out.scale_y);
  const int width = std::clamp(static_cast<int>(part.width * scale), 1, input.width);
  const int height = std::clamp(static_cast<int>(part.height * scale), 1, input.height);
  out.scale_x = static_cast<double>(width) / part.width;
  out.scale_y = static_cast<double>(height) / part.height;
  if (input.align == NetworkInput::Align::kCenter) {
    out.offset_x = (input.width - width) / 2;
    out.offset_y = (input.height - height) / 2;
  }
  return out;
}

Tensor make_input(const NetworkInput& input, const Image& image, const InputPlacement& at) {
  const ImagePart& part = at.part;
  if (image.channels != 3 || part.width < 1 || part.height < 1 || part.x < 0 || part.y < 0 ||
      part.x + part.width > image.width || part.y + part.height > image.height) {
    throw std::invalid_argument(fmt::format(
        "part {} x {} at ({}, {}) of an image of {} x {} pixels and {} channels, expected one "
        "inside an image of 3 channels",
        part.width, part.height, part.x, part.y, image.width, image.height, image.channels));
  }
  const cv::Mat all(image.height, image.width, CV_8UC3,
                    const_cast<std::uint8_t*>(image.data.data()));
  cv::Mat resized;
  const cv::Size size(static_cast<int>(std::lround(at.scale_x * part.width)),
                      static_cast<int>(std::lround(at.scale_y * part.height)));
  cv::resize(all(cv::Rect(part.x, part.y, part.width, part.height)), resized, size, 0.0, 0.0,
             cv::INTER_LINEAR);

  std::array<std::array<float, 256>, 3> value_of;  // [channel][8-bit value]
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t v = 0; v < 256; ++v) {
      const double in_range = input.low + (input.high - input.low) * static_cast<double>(v) / 255.0;
      value_of[c][v] = static_cast<float>((in_range - input.mean[c]) / input.std[c]);
    }
  }
  Tensor out{{1, 3, input.height, input.width}, {}};
  const std::size_t plane = static_cast<std::size_t>(input.width) * input.height;
  out.values.resize(3 * plane);
  const int left = static_cast<int>(at.offset_x), top = static_cast<int>(at.offset_y);
  for (std::size_t c = 0; c < 3; ++c) {
    float* values = out.values.data() + c * plane;
    std::fill(values, values + plane, value_of[c][static_cast<std::size_t>(input.padding)]);
    const int from = static_cast<int>(input.bgr ? 2 - c : c);
    for (int y = 0; y < size.height; ++y) {
      const std::uint8_t* row = resized.ptr(y) + from;
      float* to = values + static_cast<std::size_t>(y + top) * input.width + left;
      for (int x = 0; x < size.width; ++x) to[x] = value_of[c][row[3 * x]];
    }
  }
  return out;
}

Image check_image(const NetworkInput& input) {
  Image out{input.width, input.height, 3, {}};
  out.data.reserve(static_cast<std::size_t>(input.width) * input.height * 3);
  for (int y = 0; y < input.height; ++y) {
    for (int x = 0; x < input.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const int square = 64 * ((x / 32 + y / 32) % 2);
        out.data.push_back(static_cast<std::uint8_t>((x + 2 * y + 40 * c + square) % 256));
      }
    }
  }
  return out;
}

}  // namespace camber
