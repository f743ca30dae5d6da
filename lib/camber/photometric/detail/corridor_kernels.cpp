#include "camber/photometric/detail/corridor_kernels.h"

#include <cmath>

#include "camber/core/target_clones.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

inline float at_least(float value, float least) { return value > least ? value : least; }
inline float at_most(float value, float most) { return value < most ? value : most; }
inline float one_if(bool condition) { return condition ? 1.0F : 0.0F; }

CAMBER_CLONES void inverse_depth_loop(int count, RowRays rays, CorridorShape shape,
                                      float* __restrict out) {
  const float twice = 2.0F * shape.curvature;
  for (int k = 0; k < count; ++k) {
    const auto column = static_cast<float>(k);
    const float along = rays.ahead + column * rays.ahead_step;
    const float up = rays.up + column * rays.up_step;
    const float right = rays.right + column * rays.right_step;
    const float under = up * up + twice * along * along;
    const float inverse = 0.5F * (std::sqrt(at_least(under, 0.0F)) - up);
    const float depth = 1.0F / at_least(inverse, 1e-6F);
    const float away = along * depth;
    const float beside = right * depth - shape.bend * away * away;
    out[k] = at_least(inverse, 0.0F) * one_if(under > 0.0F) * one_if(along > 0.0F) *
             one_if(away < shape.reach) * one_if(std::abs(beside) < shape.half_width);
  }
}

CAMBER_CLONES void warp_loop(int count, const float* __restrict inverse_depth,
                             const float* __restrict here, const float* __restrict here_visible,
                             RowWarp w, SampledImage other, float* __restrict counts,
                             float* __restrict sum_a, float* __restrict sum_b,
                             float* __restrict sum_aa, float* __restrict sum_bb,
                             float* __restrict sum_ab) {
  const auto last_column = static_cast<float>(other.columns - 1);
  const auto last_row = static_cast<float>(other.rows - 1);
  const int pitch = other.columns;
  const std::uint32_t* __restrict cells = other.cells;
  for (int k = 0; k < count; ++k) {
    const auto column = static_cast<float>(k);
    const float rho = inverse_depth[k];
    const float px = w.x + column * w.x_step + rho * w.x_shift;
    const float py = w.y + column * w.y_step + rho * w.y_shift;
    const float pz = w.z + column * w.z_step + rho * w.z_shift;
    const float inverse = 1.0F / pz;
    const float x = w.fx * px * inverse + w.cx, y = w.fy * py * inverse + w.cy;
    // Clamped first: a column outside reads a pixel, too, and counts with the weight 0.
    const float xi = at_most(at_least(x, 0.0F), last_column - 0.5F);
    const float yi = at_most(at_least(y, 0.0F), last_row - 0.5F);
    const int x0 = static_cast<int>(xi), y0 = static_cast<int>(yi);
    const float s = xi - static_cast<float>(x0), t = yi - static_cast<float>(y0);
    const int at = y0 * pitch + x0;
    const auto cell = static_cast<int>(cells[at]);
    const auto upper_left = static_cast<float>(cell & 255);
    const auto upper_right = static_cast<float>((cell >> 8) & 255);
    const auto lower_left = static_cast<float>((cell >> 16) & 255);
    const auto lower_right = static_cast<float>((cell >> 24) & 255);
    const float upper = upper_left + s * (upper_right - upper_left);
    const float lower = lower_left + s * (lower_right - lower_left);
    const float a = here[k], b = upper + t * (lower - upper);
    const float weight = here_visible[k] * one_if(cells[at] != kHiddenCell) * one_if(rho > 0.0F) *
                         one_if(pz > 0.02F) * one_if(x >= 0.0F) * one_if(x < last_column) *
                         one_if(y >= 0.0F) * one_if(y < last_row);
    counts[k] += weight;
    sum_a[k] += weight * a;
    sum_b[k] += weight * b;
    sum_aa[k] += weight * (a * a);
    sum_bb[k] += weight * (b * b);
    sum_ab[k] += weight * (a * b);
  }
}

}  // namespace

void corridor_inverse_depths(int count, const RowRays& rays, const CorridorShape& shape,
                             float* inverse_depth) {
  inverse_depth_loop(count, rays, shape, inverse_depth);
}

void add_warped_row(int count, const float* inverse_depth, const float* here,
                    const float* here_visible, const RowWarp& warp, const SampledImage& other,
                    const ColumnSums& sums) {
  warp_loop(count, inverse_depth, here, here_visible, warp, other, sums.count, sums.a, sums.b,
            sums.aa, sums.bb, sums.ab);
}

}  // namespace camber
