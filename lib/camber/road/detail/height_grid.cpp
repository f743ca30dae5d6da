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

/// Means of what is known of each two by two cells; kNoHeight where nothing is.
/// @param first, second  rows of 2 * count cells; one row alone is given twice
CAMBER_CLONES void mean_of_pairs(const float* first, const float* second, std::size_t count,
                                 float* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const float a = first[2 * i], b = second[2 * i], c = first[2 * i + 1], d = second[2 * i + 1];
    const float sum = (a == kNoHeight ? 0.0f : a) + (b == kNoHeight ? 0.0f : b) +
                      (c == kNoHeight ? 0.0f : c) + (d == kNoHeight ? 0.0f : d);
    const float known = (a == kNoHeight ? 0.0f : 1.0f) + (b == kNoHeight ? 0.0f : 1.0f) +
                        (c == kNoHeight ? 0.0f : 1.0f) + (d == kNoHeight ? 0.0f : 1.0f);
    out[i] = known > 0.0f ? sum / known : kNoHeight;
  }
}

CAMBER_CLONES void mix(const float* near, const float* far, std::size_t count, float* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = 0.75f * near[i] + 0.25f * far[i];
}

/// Fills the gaps of a row of 2 * count cells from a coarser one that begins a cell before it.
/// @param gaps  where there was one 1 in the first of two cells, 2 in the second; else 0
CAMBER_CLONES void fill_pairs(const float* coarse, std::size_t count, float* row,
                              std::int32_t* gaps) {
  for (std::size_t i = 0; i < count; ++i) {
    const float middle = 0.75f * coarse[i + 1];
    const float left = row[2 * i], right = row[2 * i + 1];
    const bool no_left = left == kNoHeight, no_right = right == kNoHeight;
    row[2 * i] = no_left ? middle + 0.25f * coarse[i] : left;
    row[2 * i + 1] = no_right ? middle + 0.25f * coarse[i + 2] : right;
    gaps[2 * i] = no_left ? 1 : 0;
    gaps[2 * i + 1] = no_right ? 2 : 0;
  }
}

/// Replaces the marked cells of a row by the mean of their neighbours.
/// @param count  cells of a row, at least 3
/// @param space  a row's memory
CAMBER_CLONES void smooth_row(const float* above, const float* below, const std::int32_t* gaps,
                              std::int32_t mark, std::size_t count, float* row, float* space) {
  for (std::size_t i = 1; i + 1 < count; ++i) {
    space[i] = 0.25f * (row[i - 1] + row[i + 1] + above[i] + below[i]);
  }
  for (std::size_t i = 1; i + 1 < count; ++i) row[i] = gaps[i] == mark ? space[i] : row[i];
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
    for (int k = 0; k < smoothing; ++k) smooth(fine);
  }
}

void GapFiller::shrink(const HeightGrid& fine, HeightGrid& coarse) {
  coarse.width = (fine.width + 1) / 2;
  coarse.height = (fine.height + 1) / 2;
  coarse.z.resize(as_size(coarse.width) * as_size(coarse.height));
  for (int y = 0; y < coarse.height; ++y) {
    const bool two_rows = 2 * y + 1 < fine.height;
    const float* const first = fine.row(2 * y);
    const float* const second = two_rows ? fine.row(2 * y + 1) : first;
    float* const out = coarse.row(y);
    mean_of_pairs(first, second, as_size(fine.width / 2), out);
    if (fine.width % 2 != 0) {
      const float pair[2] = {first[fine.width - 1], kNoHeight},
                  below[2] = {second[fine.width - 1], kNoHeight};
      mean_of_pairs(pair, below, 1, out + fine.width / 2);
    }
  }
}

/// Fills the fine gaps by bilinear interpolation of the coarse cells, and marks them.
void GapFiller::take_from(const HeightGrid& coarse, HeightGrid& fine) {
  const std::size_t w = as_size(fine.width), half = as_size(coarse.width);
  gaps_.resize(fine.z.size());
  line_.resize(std::max(w, half + 2));
  for (int y = 0; y < fine.height; ++y) {
    const float* const near = coarse.row(y / 2);
    const float* const far =
        coarse.row(std::clamp(y / 2 + (y % 2 == 0 ? -1 : 1), 0, coarse.height - 1));
    // The coarse cells between the rows, the first and the last of them repeated outwards.
    mix(near, far, half, line_.data() + 1);
    line_[0] = line_[1];
    line_[half + 1] = line_[half];
    float* const row = fine.row(y);
    std::int32_t* const gaps = gaps_.data() + fine.at(0, y);
    fill_pairs(line_.data(), w / 2, row, gaps);
    if (w % 2 != 0) {
      float pair[2] = {row[w - 1], 0.0f};
      std::int32_t gap[2];
      fill_pairs(line_.data() + half - 1, 1, pair, gap);
      row[w - 1] = pair[0];
      gaps[w - 1] = gap[0];
    }
  }
}

/// Replaces the marked cells inside by the mean of their neighbours, row by row and every other
/// cell first, so that those above and beside are new ones where that can be.
void GapFiller::smooth(HeightGrid& grid) {
  const int w = grid.width;
  if (w < 3) return;
  line_.resize(std::max(line_.size(), as_size(w)));
  for (int y = 1; y + 1 < grid.height; ++y) {
    for (const std::int32_t mark : {1, 2}) {
      smooth_row(grid.row(y - 1), grid.row(y + 1), gaps_.data() + grid.at(0, y), mark, as_size(w),
                 grid.row(y), line_.data());
    }
  }
}

}  // namespace camber::detail
