#pragma once

#include <cmath>
#include <cstdint>

namespace camber {

/// Intensity of a colour's channel, 0 to 1, from the sRGB value that files and screens have
/// (IEC 61966-2-1).
inline double linear_from_srgb(std::uint8_t value) {
  const double c = value / 255.0;
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

}  // namespace camber
