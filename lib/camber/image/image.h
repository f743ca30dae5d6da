#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace camber {

/// An 8-bit image, rows from top to bottom, channels interleaved: 1 grey, 3 red,
/// green, blue, or, written only, 4 with an opacity that the colours are not multiplied by.
struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<std::uint8_t> data;  ///< height * width * channels

  bool empty() const { return data.empty(); }
  const std::uint8_t* row(int y) const {
    return data.data() + static_cast<std::size_t>(y) * width * channels;
  }
};

/// 8-bit intensities, rows from top to bottom, no padding.
struct GrayImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;  ///< height * width

  bool empty() const { return pixels.empty(); }
  const std::uint8_t* row(int y) const {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
};

/// A depth image: metres along z, NaN where none is known.
struct DepthImage {
  int width = 0;
  int height = 0;
  std::vector<float> metres;  ///< height * width
};

}  // namespace camber
