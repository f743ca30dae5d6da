#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "camber/synth/detail/noise.h"

namespace camber {

/// Linear light or reflectance, red green blue; 1 is a white surface in full light.
using Color = Eigen::Vector3f;

/// How a place of a surface takes the light.
struct Surface {
  Color albedo = Color::Constant(0.2f);
  float mirror = 0.0f;  ///< share of a mirror's reflection at normal incidence; 0: dull
  Color emission = Color::Zero();
};

inline Color mix(const Color& a, const Color& b, float share) { return a + share * (b - a); }

inline float clamp01(float x) { return std::clamp(x, 0.0f, 1.0f); }

/// x modulo period in [0, period).
inline float wrap(float x, float period) { return x - period * std::floor(x / period); }

/// Share of a pixel in the rectangle of half sizes (a, b) around the origin.
inline float rectangle_cover(float u, float v, float a, float b, float pixel) {
  return strip_cover(u, a, pixel) * strip_cover(v, b, pixel);
}

}  // namespace camber
