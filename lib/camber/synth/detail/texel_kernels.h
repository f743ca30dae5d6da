#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "camber/synth/detail/noise.h"

// Sums of noise over arrays of places: the inner loops of the ground's textures. Compiled for any
// x86-64 and for AVX2 (no fused multiply-add, so that both give the same bits).

namespace camber {

/// Some places of a texture: at most kMost, arrays of n.
struct TexelChunk {
  static constexpr int kMost = 256;
  int n = 0;
  const float* u = nullptr;
  const float* v = nullptr;
  const float* width = nullptr;  ///< m, of the footprint
  float narrowest = 0.0f;        ///< smallest width
};

/// A layer of noise: `stretch` 0.45 makes its features longer along u.
struct NoiseLayer {
  float amplitude = 1.0f;
  float wavelength = 1.0f;  ///< m
  std::uint32_t seed = 0;
  float stretch = 1.0f;
};

/// e^x to a relative error of about 1e-7, for |x| < 80.
inline float exp_approximate(float x) {
  const float t = 1.44269504f * x;
  const float whole = std::floor(t + 0.5f);
  const float f = (t - whole) * 0.69314718f;
  // Taylor's series of e^f for |f| <= 0.347.
  float p = 1.0f / 5040.0f;
  p = p * f + 1.0f / 720.0f;
  p = p * f + 1.0f / 120.0f;
  p = p * f + 1.0f / 24.0f;
  p = p * f + 1.0f / 6.0f;
  p = p * f + 0.5f;
  p = p * f + 1.0f;
  p = p * f + 1.0f;
  const std::int32_t bits = (static_cast<std::int32_t>(whole) + 127) << 23;
  float power;
  std::memcpy(&power, &bits, sizeof power);
  return p * power;
}

/// out += amplitude * octave(...).
void add_octave(const TexelChunk& c, const NoiseLayer& layer, float* out);
/// The same over a tile of `cells` (a power of two) wavelengths a side that repeats.
void add_repeating_octave(const TexelChunk& c, const NoiseLayer& layer, int cells, float* out);
/// out = gradient_noise of that wavelength, whatever the width.
void plain_noise(const TexelChunk& c, float wavelength, std::uint32_t seed, float* out);
/// out += amplitude * smooth_step(low, high, octave(...)).
void add_spots(const TexelChunk& c, const NoiseLayer& layer, float low, float high, float* out);

}  // namespace camber
