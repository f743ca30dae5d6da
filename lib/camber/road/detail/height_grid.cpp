#include "camber/road/detail/height_grid.h"

#include <algorithm>

#include "camber/core/target_clones.h"

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts. Both only
// compare and copy, so that their results are the same.
#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber::detail {
namespace {

CAMBER_CLONES void minimum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] < b[i] ? a[i] : b[i];
}
CAMBER_CLONES void maximum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] > b[i] ? a[i] : b[i];
}

/// Combines squares of 2 * radius + 1 cells by `combine` (minimum or maximum), the border repeated
/// outwards. Windows are doubled until they are long enough.
void slide(const HeightGrid& in, int radius,
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
    std::fill_n(line, r, from[0]);
    std::copy_n(from, w, line + r);
    std::fill_n(line + r + w, r, from[w - 1]);
    std::size_t reach = 1, valid = w + 2 * r;
    for (; 2 * reach <= length; reach *= 2) {
      valid -= reach;
      combine(line, line + reach, line, valid);
    }
    combine(line, line + (length - reach), out.z.data() + y * w, w);
  }
  for (std::size_t y = 0; y < h + 2 * r; ++y) {
    const std::size_t from = std::min(std::max(y, r) - r, h - 1);
    std::copy_n(out.z.data() + from * w, w, line + y * w);
  }
  std::size_t reach = 1, valid = h + 2 * r;
  for (; 2 * reach <= length; reach *= 2) {
    valid -= reach;
    combine(line, line + reach * w, line, valid * w);
  }
  combine(line, line + (length - reach) * w, out.z.data(), h * w);
}

}  // namespace

void erode(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space) {
  slide(in, radius, minimum, out, space);
}

void dilate(const HeightGrid& in, int radius, HeightGrid& out, std::vector<float>& space) {
  slide(in, radius, maximum, out, space);
}

void GapFiller::fill(HeightGrid& grid, int smoothing) {
  // Coarser and coarser means, until nothing is missing.
  std::size_t levels = 0;
  for (const HeightGrid* fine = &grid;; fine = &coarse_[levels++]) {
    bool gaps = false;
    for (const float z : fine->z) gaps |= z == kNoHeight;
    if (!gaps || (fine->width == 1 && fine->height == 1)) break;
    if (coarse_.size() == levels) coarse_.emplace_back();
    // emplace_back may have moved the level that `fine` points to.
    if (levels > 0) fine = &coarse_[levels - 1];
    shrink(*fine, coarse_[levels]);
  }
  for (std::size_t level = levels; level-- > 0;) {
    HeightGrid& fine = level == 0 ? grid : coarse_[level - 1];
    take_from(coarse_[level], fine);
    float* const z = fine.z.data();
    const int w = fine.width;
    for (int k = 0; k < smoothing; ++k) {
      // The one that has just changed comes last, so that few steps wait for each other.
      for (const int i : holes_) z[i] = 0.25f * (z[i + 1] + z[i - w] + z[i + w] + z[i - 1]);
    }
  }
}

void GapFiller::shrink(const HeightGrid& fine, HeightGrid& coarse) {
  coarse.width = (fine.width + 1) / 2;
  coarse.height = (fine.height + 1) / 2;
  coarse.z.resize(as_size(coarse.width) * as_size(coarse.height));
  for (int y = 0; y < coarse.height; ++y) {
    const float* const first = fine.row(2 * y);
    const float* const second = fine.row(std::min(2 * y + 1, fine.height - 1));
    const bool two_rows = 2 * y + 1 < fine.height;
    for (int x = 0; x < coarse.width; ++x) {
      float sum = 0.0f, count = 0.0f;
      const auto add = [&](float z) {
        if (z == kNoHeight) return;
        sum += z;
        count += 1.0f;
      };
      add(first[2 * x]);
      if (two_rows) add(second[2 * x]);
      if (2 * x + 1 < fine.width) {
        add(first[2 * x + 1]);
        if (two_rows) add(second[2 * x + 1]);
      }
      coarse.z[coarse.at(x, y)] = count > 0.0f ? sum / count : kNoHeight;
    }
  }
}

/// Fills the fine gaps by bilinear interpolation of the coarse cells; lists those inside.
void GapFiller::take_from(const HeightGrid& coarse, HeightGrid& fine) {
  holes_.clear();
  for (int y = 0; y < fine.height; ++y) {
    const float* const near = coarse.row(y / 2);
    const float* const far =
        coarse.row(std::clamp(y / 2 + (y % 2 == 0 ? -1 : 1), 0, coarse.height - 1));
    float* const row = fine.row(y);
    const bool inside = y > 0 && y + 1 < fine.height;
    for (int x = 0; x < fine.width; ++x) {
      if (row[x] != kNoHeight) continue;
      const int x0 = x / 2, x1 = std::clamp(x0 + (x % 2 == 0 ? -1 : 1), 0, coarse.width - 1);
      row[x] = 0.5625f * near[x0] + 0.1875f * (near[x1] + far[x0]) + 0.0625f * far[x1];
      if (inside && x > 0 && x + 1 < fine.width) holes_.push_back(y * fine.width + x);
    }
  }
}

}  // namespace camber::detail
