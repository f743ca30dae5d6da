#include "camber/image/detail/cubic_sampling.h"

#include <algorithm>
#include <cstring>

#include "camber/core/target_clones.h"

namespace camber::detail {
namespace {

using F4 = float __attribute__((vector_size(16)));

CAMBER_TARGET_CLONES("avx2")
void sample_loop(float a, const float* image, std::ptrdiff_t pitch, int width, int height,
                 int count, const float* x, const float* y, const float* outside, float* out) {
  // Weights of the four pixels around a place, polynomials in its fraction.
  const F4 cubic = {a, a + 2.0F, -(a + 2.0F), -a};
  const F4 square = {-2.0F * a, -(a + 3.0F), 2.0F * a + 3.0F, a};
  const F4 linear = {a, 0.0F, -a, 0.0F};
  const F4 constant = {0.0F, 1.0F, 0.0F, 0.0F};
  const auto right = static_cast<float>(width - 1), bottom = static_cast<float>(height - 1);
  for (int k = 0; k < count; ++k) {
    const float u = x[k], v = y[k];
    if (!(u >= 0.0F && v >= 0.0F && u <= right && v <= bottom)) {
      out[k] = outside[k];
      continue;
    }
    const int column = static_cast<int>(u), row = static_cast<int>(v);
    const float s = u - static_cast<float>(column), t = v - static_cast<float>(row);
    const F4 across = ((cubic * s + square) * s + linear) * s + constant;
    const F4 down = ((cubic * t + square) * t + linear) * t + constant;
    F4 rows[4];
    if (column >= 1 && row >= 1 && column + 2 < width && row + 2 < height) {
      const float* first = image + (row - 1) * pitch + column - 1;
      for (int r = 0; r < 4; ++r) std::memcpy(&rows[r], first + r * pitch, sizeof(F4));
    } else {
      for (int r = 0; r < 4; ++r) {
        const float* from = image + std::min(std::max(row - 1 + r, 0), height - 1) * pitch;
        for (int c = 0; c < 4; ++c) {
          rows[r][c] = from[std::min(std::max(column - 1 + c, 0), width - 1)];
        }
      }
    }
    const F4 sum = across * ((rows[0] * down[0] + rows[1] * down[1]) +
                             (rows[2] * down[2] + rows[3] * down[3]));
    out[k] = (sum[0] + sum[2]) + (sum[1] + sum[3]);
  }
}

}  // namespace

void sample_cubic(const FloatImage& image, float sharpness, int count, const float* x,
                  const float* y, const float* outside, float* out) {
  sample_loop(sharpness, image.pixels, image.pitch, image.width, image.height, count, x, y, outside,
              out);
}

}  // namespace camber::detail
