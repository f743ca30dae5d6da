#include "camber/synth/detail/texel_kernels.h"

#include "camber/core/target_clones.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

/// gradient_noise whose lattice repeats after `mask` + 1 cells.
inline float repeating_noise(Texel p, std::int32_t mask, std::uint32_t seed) {
  const float fu = std::floor(p.u), fv = std::floor(p.v);
  const auto iu = static_cast<std::int32_t>(fu), iv = static_cast<std::int32_t>(fv);
  const float x = p.u - fu, y = p.v - fv;
  const auto corner = [&](int du, int dv) {
    const std::uint32_t h = hash_lattice((iu + du) & mask, (iv + dv) & mask, seed);
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

CAMBER_CLONES void octave_loop(int n, const float* __restrict u, const float* __restrict v,
                               const float* __restrict width, NoiseLayer layer,
                               float* __restrict out) {
  const float inverse = 1.0f / layer.wavelength;
  for (int i = 0; i < n; ++i) {
    const Texel p{inverse * (layer.stretch * u[i]), inverse * v[i]};
    out[i] += layer.amplitude *
              (octave_weight(layer.wavelength, width[i]) * gradient_noise(p, layer.seed));
  }
}

CAMBER_CLONES void repeating_loop(int n, const float* __restrict u, const float* __restrict v,
                                  const float* __restrict width, NoiseLayer layer,
                                  std::int32_t mask, float* __restrict out) {
  const float inverse = 1.0f / layer.wavelength;
  for (int i = 0; i < n; ++i) {
    const Texel p{inverse * u[i], inverse * v[i]};
    out[i] += layer.amplitude *
              (octave_weight(layer.wavelength, width[i]) * repeating_noise(p, mask, layer.seed));
  }
}

CAMBER_CLONES void noise_loop(int n, const float* __restrict u, const float* __restrict v,
                              float inverse, std::uint32_t seed, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = gradient_noise({inverse * u[i], inverse * v[i]}, seed);
}

CAMBER_CLONES void spots_loop(int n, const float* __restrict u, const float* __restrict v,
                              const float* __restrict width, NoiseLayer layer, float low,
                              float high, float* __restrict out) {
  const float inverse = 1.0f / layer.wavelength;
  for (int i = 0; i < n; ++i) {
    const Texel p{inverse * u[i], inverse * v[i]};
    const float level = octave_weight(layer.wavelength, width[i]) * gradient_noise(p, layer.seed);
    out[i] += layer.amplitude * smooth_step(low, high, level);
  }
}

bool too_fine(const TexelChunk& c, const NoiseLayer& layer) {
  return octave_weight(layer.wavelength, c.narrowest) <= 0.0f;
}

}  // namespace

void add_octave(const TexelChunk& c, const NoiseLayer& layer, float* out) {
  if (!too_fine(c, layer)) octave_loop(c.n, c.u, c.v, c.width, layer, out);
}

void add_repeating_octave(const TexelChunk& c, const NoiseLayer& layer, int cells, float* out) {
  if (!too_fine(c, layer)) repeating_loop(c.n, c.u, c.v, c.width, layer, cells - 1, out);
}

void plain_noise(const TexelChunk& c, float wavelength, std::uint32_t seed, float* out) {
  noise_loop(c.n, c.u, c.v, 1.0f / wavelength, seed, out);
}

void add_spots(const TexelChunk& c, const NoiseLayer& layer, float low, float high, float* out) {
  if (!too_fine(c, layer)) spots_loop(c.n, c.u, c.v, c.width, layer, low, high, out);
}

}  // namespace camber
