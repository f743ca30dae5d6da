#pragma once

// Inner loops of the direct refinement, one row of the image each. Compiled for any x86-64 and for
// AVX2 (no fused multiply-add, so that both give the same bits).

#include "camber/photometric/detail/corridor_kernels.h"

namespace camber {

/// Where the columns of a row are seen in another image.
struct WarpedRow {
  float* x = nullptr;       ///< px; kNotWarped outside
  float* y = nullptr;       ///< px
  float* inside = nullptr;  ///< 1, or 0 outside the other image less its border
};
constexpr float kNotWarped = -1000.0F;

/// @param right, bottom  largest x and y, px; the least are 1.
void warp_row(int count, const float* inverse_depth, const RowWarp& warp, float right, float bottom,
              const WarpedRow& out);

/// (intensity - mean) / sqrt(variance + least_contrast^2), mean and variance from sums over a
/// window.
/// @param weight  number of pixels of the window, as a share of what the sums count.
void normalise_row(int count, const float* intensity, const float* weight, const float* sum,
                   const float* sum_of_squares, float least_contrast, float* out);

/// Squared residual over what noise and a misalignment by mended_px let expect, at most 16; 0 where
/// not valid.
void excess_row(int count, const float* residual, const float* by_x, const float* by_y,
                const float* valid, float noise_variance, float mended_px, float* out);

}  // namespace camber
