#pragma once

#include <cstdint>

#include "camber/image/image_io.h"

namespace camber {

/// A colour picture of one grey level. @throws std::invalid_argument if a side is not 1 to 65535.
Image make_picture(int width, int height, std::uint8_t grey);

/// A picture of 3 channels in a smaller size, by means over areas. @param width  pixels, at least 1
/// and at most the picture's.
Image shrink_picture(const Image& picture, int width);

/// Throws std::invalid_argument unless the picture has sides of at least 1, 3 channels and as many
/// bytes as that needs. @param name how the sentence calls it.
void require_picture(const Image& picture, const char* name);

}  // namespace camber
