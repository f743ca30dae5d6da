#include "camber/photometric/detail/direct_kernels.h"

#include <cmath>

#include "camber/core/target_clones.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

inline float at_least(float value, float least) { return value > least ? value : least; }
inline float at_most(float value, float most) { return value < most ? value : most; }

CAMBER_CLONES void warp_loop(int count, const float* __restrict inverse_depth, RowWarp w,
                             float right, float bottom, float* __restrict out_x,
                             float* __restrict out_y, float* __restrict inside) {
  for (int k = 0; k < count; ++k) {
    const auto column = static_cast<float>(k);
    const float rho = inverse_depth[k];
    const float px = w.x + column * w.x_step + rho * w.x_shift;
    const float py = w.y + column * w.y_step + rho * w.y_shift;
    const float pz = w.z + column * w.z_step + rho * w.z_shift;
    const float inverse = 1.0F / pz;
    const float x = w.fx * px * inverse + w.cx, y = w.fy * py * inverse + w.cy;
    const bool in = (pz > 1e-3F) & (x > 1.0F) & (x < right) & (y > 1.0F) & (y < bottom);
    out_x[k] = in ? x : kNotWarped;
    out_y[k] = in ? y : kNotWarped;
    inside[k] = in ? 1.0F : 0.0F;
  }
}

CAMBER_CLONES void normalise_loop(int count, const float* __restrict intensity,
                                  const float* __restrict weight, const float* __restrict sum,
                                  const float* __restrict squares, float noise_variance,
                                  float* __restrict out) {
  for (int k = 0; k < count; ++k) {
    const float n = 1.0F / at_least(weight[k], 1e-3F);
    const float mean = sum[k] * n;
    const float variance = at_least(squares[k] * n - mean * mean, 0.0F);
    out[k] = (intensity[k] - mean) / std::sqrt(variance + noise_variance);
  }
}

CAMBER_CLONES void excess_loop(int count, const float* __restrict residual,
                               const float* __restrict by_x, const float* __restrict by_y,
                               const float* __restrict valid, float noise_variance,
                               float mended_variance, float* __restrict out) {
  for (int k = 0; k < count; ++k) {
    const float expected =
        noise_variance + mended_variance * (by_x[k] * by_x[k] + by_y[k] * by_y[k]);
    out[k] = valid[k] * at_most(residual[k] * residual[k] / expected, 16.0F);
  }
}

}  // namespace

void warp_row(int count, const float* inverse_depth, const RowWarp& warp, float right, float bottom,
              const WarpedRow& out) {
  warp_loop(count, inverse_depth, warp, right, bottom, out.x, out.y, out.inside);
}

void normalise_row(int count, const float* intensity, const float* weight, const float* sum,
                   const float* sum_of_squares, float noise, float* out) {
  normalise_loop(count, intensity, weight, sum, sum_of_squares, noise * noise, out);
}

void excess_row(int count, const float* residual, const float* by_x, const float* by_y,
                const float* valid, float noise_variance, float mended_px, float* out) {
  excess_loop(count, residual, by_x, by_y, valid, noise_variance, mended_px * mended_px, out);
}

}  // namespace camber
