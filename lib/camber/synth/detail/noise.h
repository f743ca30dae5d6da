#pragma once

#include <cmath>
#include <cstdint>

namespace camber {

/// A point or vector of a texture, m.
struct Texel {
  float u = 0.0f, v = 0.0f;
};
inline Texel operator+(Texel a, Texel b) { return {a.u + b.u, a.v + b.v}; }
inline Texel operator*(float k, Texel a) { return {k * a.u, k * a.v}; }

/// 32 well-mixed bits of a lattice place (the finaliser of MurmurHash3 over a linear combination).
inline std::uint32_t hash_lattice(std::int32_t x, std::int32_t y, std::uint32_t seed) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8DA6B343u ^
                    static_cast<std::uint32_t>(y) * 0xD8163841u ^ seed * 0xCB1AB31Fu;
  h ^= h >> 16;
  h *= 0x85EBCA6Bu;
  h ^= h >> 13;
  h *= 0xC2B2AE35u;
  h ^= h >> 16;
  return h;
}

/// Uniform in [0, 1) for a lattice place.
inline float hash_unit(std::int32_t x, std::int32_t y, std::uint32_t seed) {
  return static_cast<float>(hash_lattice(x, y, seed) >> 8) * (1.0f / 16777216.0f);
}

/// Gradient noise (Perlin, "Improving Noise", SIGGRAPH 2002) with one feature a unit of length:
/// zero mean, within about [-1, 1], standard deviation about 0.27, next to no power above
/// frequency 1.
/// @param mask  the lattice repeats after mask + 1 cells, a power of two; -1: never
inline float gradient_noise(Texel p, std::uint32_t seed, std::int32_t mask = -1) {
  const float fu = std::floor(p.u), fv = std::floor(p.v);
  const auto iu = static_cast<std::int32_t>(fu), iv = static_cast<std::int32_t>(fv);
  const float x = p.u - fu, y = p.v - fv;
  const auto corner = [&](int du, int dv) {
    const std::uint32_t h = hash_lattice((iu + du) & mask, (iv + dv) & mask, seed);
    // Sixteen-bit components of a gradient in [-1, 1]^2.
    const float gx = static_cast<float>(h & 0xFFFFu) * (2.0f / 65535.0f) - 1.0f;
    const float gy = static_cast<float>(h >> 16) * (2.0f / 65535.0f) - 1.0f;
    return gx * (x - static_cast<float>(du)) + gy * (y - static_cast<float>(dv));
  };
  const auto fade = [](float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); };
  const float a = fade(x), b = fade(y);
  const float top = corner(0, 0) + a * (corner(1, 0) - corner(0, 0));
  const float bottom = corner(0, 1) + a * (corner(1, 1) - corner(0, 1));
  return 1.5f * (top + b * (bottom - top));
}

/// Smooth step from 0 at low to 1 at high.
inline float smooth_step(float low, float high, float x) {
  float t = (x - low) / (high - low);
  t = t < 0.0f ? 0.0f : (t > 1.0f ? 1.0f : t);
  return t * t * (3.0f - 2.0f * t);
}

/// How much of a texture of one wavelength survives a pixel of a given width: 1 if the pixel is
/// below a third of it, 0 above two thirds (beyond that it would alias).
inline float octave_weight(float wavelength, float pixel) {
  return 1.0f - smooth_step(0.33f, 0.66f, pixel / wavelength);
}

/// One octave of gradient noise of a wavelength in metres, left out where the pixel cannot hold it.
inline float octave(Texel p, float wavelength, float pixel, std::uint32_t seed) {
  const float weight = octave_weight(wavelength, pixel);
  if (weight <= 0.0f) return 0.0f;
  return weight * gradient_noise((1.0f / wavelength) * p, seed);
}

/// Share of a pixel of width `pixel` centred at x that lies below an edge at 0: 1 for x << 0.
inline float below_edge(float x, float pixel) {
  const float t = 0.5f - x / (pixel > 1e-6f ? pixel : 1e-6f);
  return t < 0.0f ? 0.0f : (t > 1.0f ? 1.0f : t);
}

/// Share of a pixel of width `pixel` centred at x that the strip |x| < half_width covers.
inline float strip_cover(float x, float half_width, float pixel) {
  const float half = 0.5f * (pixel > 1e-6f ? pixel : 1e-6f);
  const float low = x - half > -half_width ? x - half : -half_width;
  const float high = x + half < half_width ? x + half : half_width;
  return high > low ? (high - low) / (2.0f * half) : 0.0f;
}

}  // namespace camber
