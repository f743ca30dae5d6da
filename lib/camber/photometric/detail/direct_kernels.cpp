#include "camber/photometric/detail/direct_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "camber/core/target_clones.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

constexpr double kBlurReach = 4.0;  // standard deviations

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
    const float n = 1.0F / at_least(weight[k], 1.0F);
    const float mean = sum[k] * n;
    const float variance = at_least(squares[k] * n - mean * mean, 0.0F);
    out[k] = (intensity[k] - mean) / std::sqrt(variance + noise_variance);
  }
}

/// Moves sums over rows down by one: adds the row that comes in, takes out the one that leaves.
CAMBER_CLONES void move_sums(int count, const float* __restrict in, const float* __restrict out,
                             float* __restrict sums) {
  for (int k = 0; k < count; ++k) sums[k] += in[k] - out[k];
}

CAMBER_CLONES void move_squares(int count, const float* __restrict in, const float* __restrict out,
                                float* __restrict sums) {
  for (int k = 0; k < count; ++k) sums[k] += in[k] * in[k] - out[k] * out[k];
}

/// Sums of `wide` neighbours from each place on, by those of 1, 2, 4, ...
/// @param values  count + wide - 1 of them; destroyed.
CAMBER_CLONES void running_sums(int count, int wide, float* values, float* __restrict out) {
  for (int k = 0; k < count; ++k) out[k] = 0.0F;
  int from = 0;
  for (int power = 1; power <= wide; power *= 2) {
    if (wide & power) {
      const float* __restrict part = values + from;
      for (int k = 0; k < count; ++k) out[k] += part[k];
      from += power;
    }
    const int left = count + wide - 1 - 2 * power + 1;
    for (int k = 0; k < left; ++k) values[k] += values[k + power];
  }
}

/// @param taps  2 * reach + 1, symmetric.
CAMBER_CLONES void blur_rows(int count, int reach, const float* __restrict taps,
                             const float* const* rows, float* __restrict out) {
  for (int k = 0; k < count; ++k) out[k] = taps[reach] * rows[reach][k];
  for (int r = 1; r <= reach; ++r) {
    const float weight = taps[reach + r];
    const float* __restrict above = rows[reach - r];
    const float* __restrict below = rows[reach + r];
    for (int k = 0; k < count; ++k) out[k] += weight * (above[k] + below[k]);
  }
}

CAMBER_CLONES void blur_row(int count, int reach, const float* __restrict taps,
                            const float* __restrict row, float* __restrict out) {
  for (int k = 0; k < count; ++k) out[k] = taps[reach] * row[k];
  for (int r = 1; r <= reach; ++r) {
    const float weight = taps[reach + r];
    const float* __restrict left = row - r;
    const float* __restrict right = row + r;
    for (int k = 0; k < count; ++k) out[k] += weight * (left[k] + right[k]);
  }
}

CAMBER_CLONES void gradient_loop(int count, const float* __restrict a0, const float* __restrict a1,
                                 const float* __restrict a2, const float* __restrict b0,
                                 const float* __restrict b1, const float* __restrict b2,
                                 float* __restrict by_x, float* __restrict by_y) {
  for (int k = 1; k + 1 < count; ++k) {
    const float upper_left = a0[k - 1] + b0[k - 1], upper_right = a0[k + 1] + b0[k + 1];
    const float lower_left = a2[k - 1] + b2[k - 1], lower_right = a2[k + 1] + b2[k + 1];
    by_x[k] = 0.0625F * ((upper_right - upper_left) + (lower_right - lower_left) +
                         2.0F * ((a1[k + 1] + b1[k + 1]) - (a1[k - 1] + b1[k - 1])));
    by_y[k] = 0.0625F * ((lower_left - upper_left) + (lower_right - upper_right) +
                         2.0F * ((a2[k] + b2[k]) - (a0[k] + b0[k])));
  }
}

/// The index of a row or column beyond the rim, mirrored without the rim itself.
int mirrored(int i, int count) {
  if (count == 1) return 0;
  const int period = 2 * (count - 1);
  const int k = ((i % period) + period) % period;
  return k < count ? k : period - k;
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

void window_sums(int width, const std::vector<ColumnSpan>& wanted, const float* values,
                 int window_wide, int window_high, float* sums, float* squares) {
  const int side = window_wide / 2, below = window_high / 2;
  const int rows = static_cast<int>(wanted.size());
  const auto count = static_cast<std::size_t>(width);
  const std::vector<float> none(count, 0.0F);
  std::vector<float> padded(count + static_cast<std::size_t>(window_wide));
  std::vector<float> of_columns[2] = {std::vector<float>(count, 0.0F),
                                      std::vector<float>(count, 0.0F)};
  const auto row = [&](int y) {
    return values + static_cast<std::ptrdiff_t>(mirrored(y, rows)) * width;
  };
  // The first row's window comes in row by row.
  for (int y = -2 * below; y < rows; ++y) {
    const bool filling = y <= 0;
    for (const bool squared : {false, true}) {
      if (squared && !squares) continue;
      std::vector<float>& columns = of_columns[squared];
      (squared ? move_squares : move_sums)(
          width, row(y + below), filling ? none.data() : row(y - below - 1), columns.data());
      if (y < 0) continue;
      const ColumnSpan span = wanted[static_cast<std::size_t>(y)];
      if (span.count() <= 0) continue;
      const int first = std::max(0, span.from - side), last = std::min(width, span.to + side);
      float* const middle = padded.data() + side;
      std::copy(columns.begin() + first, columns.begin() + last, middle + first);
      for (int k = span.from - side; k < 0; ++k) {
        middle[k] = columns[static_cast<std::size_t>(mirrored(k, width))];
      }
      for (int k = width; k < span.to + side; ++k) {
        middle[k] = columns[static_cast<std::size_t>(mirrored(k, width))];
      }
      running_sums(span.count(), window_wide, padded.data() + span.from,
                   (squared ? squares : sums) + static_cast<std::ptrdiff_t>(y) * width + span.from);
    }
  }
}

int blur_reach(double sigma) { return static_cast<int>(std::ceil(kBlurReach * sigma)); }

void blur_plane(int width, const std::vector<ColumnSpan>& wanted, const float* values, double sigma,
                float* out) {
  const int reach = blur_reach(sigma), rows = static_cast<int>(wanted.size());
  std::vector<float> taps(static_cast<std::size_t>(2 * reach + 1));
  double sum = 0.0;
  for (int k = -reach; k <= reach; ++k) sum += std::exp(-0.5 * k * k / (sigma * sigma));
  for (int k = -reach; k <= reach; ++k) {
    taps[static_cast<std::size_t>(k + reach)] =
        static_cast<float>(std::exp(-0.5 * k * k / (sigma * sigma)) / sum);
  }
  std::vector<const float*> around(taps.size());
  std::vector<float> padded(static_cast<std::size_t>(width + 2 * reach));
  float* const row = padded.data() + reach;
  for (int y = 0; y < rows; ++y) {
    const ColumnSpan span = wanted[static_cast<std::size_t>(y)];
    if (span.count() <= 0) continue;
    const int first = std::max(0, span.from - reach), last = std::min(width, span.to + reach);
    for (int k = -reach; k <= reach; ++k) {
      around[static_cast<std::size_t>(k + reach)] =
          values + static_cast<std::ptrdiff_t>(mirrored(y + k, rows)) * width + first;
    }
    blur_rows(last - first, reach, taps.data(), around.data(), row + first);
    for (int k = span.from - reach; k < 0; ++k) row[k] = row[mirrored(k, width)];
    for (int k = width; k < span.to + reach; ++k) row[k] = row[mirrored(k, width)];
    blur_row(span.count(), reach, taps.data(), row + span.from,
             out + static_cast<std::ptrdiff_t>(y) * width + span.from);
  }
}

void gradient_row(int count, const float* const a[3], const float* const b[3], float* by_x,
                  float* by_y) {
  gradient_loop(count, a[0], a[1], a[2], b[0], b[1], b[2], by_x, by_y);
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
