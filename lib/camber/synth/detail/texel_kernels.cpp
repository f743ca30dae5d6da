#include "camber/synth/detail/texel_kernels.h"

#include "camber/core/target_clones.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

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
              (octave_weight(layer.wavelength, width[i]) * gradient_noise(p, layer.seed, mask));
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
