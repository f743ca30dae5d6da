#pragma once

// Inner loops of the plane search: one row of the corridor, column by column. Compiled for any
// x86-64 and for AVX2 (no fused multiply-add, so that both give the same bits).

#include <cstdint>

namespace camber {

/// Rays along one row: the components of column k are first + k * step.
struct RowRays {
  float ahead = 0.0F, ahead_step = 0.0F;
  float up = 0.0F, up_step = 0.0F;
  float right = 0.0F, right_step = 0.0F;
};

/// A road that bends evenly, and the part of it that is compared. Camera heights.
struct CorridorShape {
  float curvature = 0.0F;  ///< vertical, positive: a sag
  float bend = 0.0F;       ///< of the driven path, to the right
  float reach = 0.0F;      ///< ahead
  float half_width = 0.0F;
};

/// Inverse depths, 1/camera height, of `count` columns; 0 outside the corridor.
void corridor_inverse_depths(int count, const RowRays& rays, const CorridorShape& shape,
                             float* inverse_depth);

/// How the row's points appear in another image: (x, y, z) = first + k * step + inverse depth *
/// shift in its camera's frame.
struct RowWarp {
  float x = 0.0F, y = 0.0F, z = 0.0F;
  float x_step = 0.0F, y_step = 0.0F, z_step = 0.0F;
  float x_shift = 0.0F, y_shift = 0.0F, z_shift = 0.0F;
  float fx = 0.0F, fy = 0.0F, cx = 0.0F, cy = 0.0F;
};

/// An image, rows without gaps. A cell holds the four pixels around a place between them, so that
/// one access reads them all: from the lowest byte, a pixel, that to its right, that below it, and
/// that to the right of that; kHiddenCell where something hides the first.
struct SampledImage {
  const std::uint32_t* cells = nullptr;
  int columns = 0, rows = 0;  ///< at least 2
};
constexpr std::uint32_t kHiddenCell = 0xFFFFFFFFU;  // four white pixels have no texture

/// Sums for the correlation of two images, one entry a column.
struct ColumnSums {
  float* count = nullptr;
  float* a = nullptr;  ///< of the reference
  float* b = nullptr;  ///< of the other image, bilinear
  float* aa = nullptr;
  float* bb = nullptr;
  float* ab = nullptr;
};

/// Adds the columns of a row whose points both images show.
/// @param here, here_visible  the reference's intensities and visibility, `count` columns.
void add_warped_row(int count, const float* inverse_depth, const float* here,
                    const float* here_visible, const RowWarp& warp, const SampledImage& other,
                    const ColumnSums& sums);

}  // namespace camber
