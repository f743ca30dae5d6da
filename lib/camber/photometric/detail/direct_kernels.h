#pragma once

// Inner loops of the direct refinement, one row of the image each. Compiled for any x86-64 and for
// AVX2 (no fused multiply-add, so that both give the same bits).

#include <vector>

#include "camber/photometric/detail/corridor_kernels.h"

namespace camber {

/// Columns of a row that are wanted, from `from` to before `to`.
struct ColumnSpan {
  int from = 0, to = 0;
  int count() const { return to - from; }
};

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

/// Sums over a window around every wanted pixel, the rim mirrored; windows are odd.
/// @param wanted   one span a row.
/// @param squares  sums of the squares, too; null: not wanted.
void window_sums(int width, const std::vector<ColumnSpan>& wanted, const float* values,
                 int window_wide, int window_high, float* sums, float* squares);

/// Gaussian blur of the wanted pixels; the rim is mirrored.
/// @param wanted  one span a row.
void blur_plane(int width, const std::vector<ColumnSpan>& wanted, const float* values, double sigma,
                float* out);
/// How far a blur reaches, px.
int blur_reach(double sigma);

/// (intensity - mean) / sqrt(variance + least_contrast^2) for a row, mean and variance from sums
/// over a window.
/// @param weight  number of pixels that were summed.
void normalise_row(int count, const float* intensity, const float* weight, const float* sum,
                   const float* sum_of_squares, float least_contrast, float* out);

/// Derivatives of the mean of two images along a row, an eighth of Sobel's.
/// @param a, b  three rows of each, from above.
void gradient_row(int count, const float* const a[3], const float* const b[3], float* by_x,
                  float* by_y);

/// Squared residual over what noise and a misalignment by mended_px let expect, at most 16; 0 where
/// not valid.
void excess_row(int count, const float* residual, const float* by_x, const float* by_y,
                const float* valid, float noise_variance, float mended_px, float* out);

}  // namespace camber
