#include "camber/road/detail/height_grid.h"

#include <algorithm>

#include "camber/core/target_clones.h"

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts. Their
// results are the same: neither fuses multiplications with additions.
#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber::detail {
namespace {

CAMBER_CLONES void minimum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] < b[i] ? a[i] : b[i];
}
CAMBER_CLONES void maximum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] > b[i] ? a[i] : b[i];
}

/// Combines squares of 2 * radius + 1 cells by `combine` (minimum or maximum), `nothing` beyond the
/// border. Windows are doubled until they are long enough.
void slide(const HeightGrid& in, int radius, float nothing,
           void (*combine)(const float*, const float*, float*, std::size_t), HeightGrid& out,
           std::vector<float>& space) {
  const std::size_t w = as_size(in.width), h = as_size(in.height), r = as_size(radius);
  const std::size_t length = 2 * r + 1;
  out.width = in.width;
  out.height = in.height;
  out.z.resize(in.z.size());
  space.resize(std::max(w + 2 * r, w * (h + 2 * r)));
  float* const line = space.data();
  for (std::size_t y = 0; y < h; ++y) {
    const float* const from = in.z.data() + y * w;
    std::fill_n(line, r, nothing);
    std::copy_n(from, w, line + r);
    std::fill_n(line + r + w, r, nothing);
    std::size_t reach = 1, valid = w + 2 * r;
    for (; 2 * reach <= length; reach *= 2) {
      valid -= reach;
      combine(line, line + reach, line, valid);
    }
    combine(line, line + (length - reach), out.z.data() + y * w, w);
  }
  std::fill_n(line, r * w, nothing);
  std::copy_n(out.z.data(), h * w, line + r * w);
  std::fill_n(line + (r + h) * w, r * w, nothing);
  std::size_t reach = 1, valid = h + 2 * r;
  for (; 2 * reach <= length; reach *= 2) {
    valid -= reach;
    combine(line, line + reach * w, line, valid * w);
  }
  combine(line, line + (length - reach) * w, out.z.data(), h * w);
}

}  // namespace

void erode(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space) {
  slide(in, radius, kNoHeight, minimum, out, space);
}

void dilate(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space) {
  HeightGrid known = in;
  for (float& z : known.z) z = z == kNoHeight ? -kNoHeight : z;
  slide(known, radius, -kNoHeight, maximum, out, space);
}

}  // namespace camber::detail
