#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "camber/image/image.h"

namespace camber {

/// Pixels as a camera's driver hands them out.
struct RawPixels {
  int width = 0, height = 0;
  std::string encoding;                ///< ROS's name
  std::size_t step = 0;                ///< bytes from row to row
  const std::uint8_t* data = nullptr;  ///< height * step bytes, not owned
  bool big_endian = false;             ///< of 16 bits
};

/// The encodings of decode_raw_pixels(), for messages.
const char* raw_pixel_encodings();

/// @return 1 channel for grey, else 3 (Bayer patterns by OpenCV's bilinear interpolation, of even
/// width and height; alpha is dropped; of grey of 16 bits the upper byte is taken); nothing for
/// another encoding, a step that is too short, or grey of 16 bits that fills only the lower 12.
std::optional<Image> decode_raw_pixels(const RawPixels& raw);

}  // namespace camber
