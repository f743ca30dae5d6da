#include "camber/motion/detail/inverse_search_flow.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "camber/core/target_clones.h"

#define CAMBER_ALWAYS_INLINE inline __attribute__((always_inline))

namespace camber::detail {
namespace {

constexpr int kPatch = 8;  // px, wide and high
constexpr float kPatchPixels = kPatch * kPatch;
/// Gradients' energy of a patch, (intensity / px)^2 summed, below which only noise moves it.
constexpr float kLeastEnergy = 1.0F;
constexpr float kConverged = 0.01F;  // px, of a step
/// Of a Gauss-Newton step: whole ones overshoot where texture is finer than the error, and a patch
/// stops where it fits worse.
constexpr float kStepShare = 0.5F;

using F4 = float __attribute__((vector_size(16)));
using F8 = float __attribute__((vector_size(32)));

CAMBER_ALWAYS_INLINE void load(const float* from, F8& to) { std::memcpy(&to, from, sizeof(F8)); }

CAMBER_ALWAYS_INLINE float sum_of(const F8& v) {
  F4 halves[2];
  std::memcpy(halves, &v, sizeof(F8));
  F4 s = halves[0] + halves[1];
  s += __builtin_shufflevector(s, s, 2, 3, 0, 1);
  return s[0] + s[1];
}

/// A patch of the one image against one of the other at a fraction of a pixel.
struct PatchPair {
  const float* here;   // first pixel
  const float* there;  // whole pixel of the first sample
  std::ptrdiff_t here_pitch, there_pitch;
  float right, down;  // of the samples from their whole pixels, px
};

/// One row of samples less the first image's; `above` becomes the row below it.
CAMBER_ALWAYS_INLINE void difference_row(const PatchPair& p, int row, F8& above, F8& out) {
  F8 a, b, here;
  const float* next = p.there + (row + 1) * p.there_pitch;
  load(next, a);
  load(next + 1, b);
  load(p.here + row * p.here_pitch, here);
  const F8 below = a + p.right * (b - a);
  out = above + p.down * (below - above) - here;
  above = below;
}

CAMBER_ALWAYS_INLINE void first_row(const PatchPair& p, F8& out) {
  F8 a, b;
  load(p.there, a);
  load(p.there + 1, b);
  out = a + p.right * (b - a);
}

/// Sum of the squared differences, their mean taken out.
CAMBER_ALWAYS_INLINE float squared_difference(const PatchPair& p) {
  F8 above, d, sum = {}, squares = {};
  first_row(p, above);
  for (int row = 0; row < kPatch; ++row) {
    difference_row(p, row, above, d);
    sum += d;
    squares += d * d;
  }
  const float s = sum_of(sum);
  return sum_of(squares) - s * s / kPatchPixels;
}

/// Normal equations of a patch's displacement.
struct PatchNormal {
  float xx, xy, yy;    // mean taken out
  float sum_x, sum_y;  // of the derivatives
  float inverse_determinant;
};

CAMBER_ALWAYS_INLINE void normal_of(const float* by_x, const float* by_y, std::ptrdiff_t pitch,
                                    PatchNormal& out) {
  F8 x, y, sx = {}, sy = {}, xx = {}, xy = {}, yy = {};
  for (int row = 0; row < kPatch; ++row) {
    load(by_x + row * pitch, x);
    load(by_y + row * pitch, y);
    sx += x;
    sy += y;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  out.sum_x = sum_of(sx);
  out.sum_y = sum_of(sy);
  out.xx = sum_of(xx) - out.sum_x * out.sum_x / kPatchPixels + kLeastEnergy;
  out.xy = sum_of(xy) - out.sum_x * out.sum_y / kPatchPixels;
  out.yy = sum_of(yy) - out.sum_y * out.sum_y / kPatchPixels + kLeastEnergy;
  out.inverse_determinant =
      1.0F / std::max(out.xx * out.yy - out.xy * out.xy, kLeastEnergy * (out.xx + out.yy));
}

/// The patches of one level, and what is known of them.
struct PatchGrid {
  int columns = 0, rows = 0, stride = 1, width = 0, height = 0;
  std::vector<float> u, v;              // px
  std::vector<float> start_u, start_v;  // of a first guess; may be empty
  std::vector<PatchNormal> normal;
  std::vector<std::uint8_t> wanted;

  PatchGrid(int image_width, int image_height, int spacing)
      : columns((image_width - kPatch + spacing - 1) / spacing + 1),
        rows((image_height - kPatch + spacing - 1) / spacing + 1),
        stride(spacing),
        width(image_width),
        height(image_height),
        u(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows)),
        v(u.size()),
        normal(u.size()),
        wanted(u.size(), 1) {}
  // The last ones end at the rim.
  int left(int column) const { return std::min(column * stride, width - kPatch); }
  int top(int row) const { return std::min(row * stride, height - kPatch); }
};

CAMBER_ALWAYS_INLINE void place(const PatchGrid& grid, const float* there, std::ptrdiff_t pitch,
                                int x, int y, float u, float v, PatchPair& pair) {
  const float least = 1.0F - kPatch;
  const float px =
      std::min(std::max(static_cast<float>(x) + u, least), static_cast<float>(grid.width) - 1.0F);
  const float py =
      std::min(std::max(static_cast<float>(y) + v, least), static_cast<float>(grid.height) - 1.0F);
  // Positive before they are cut, so that cutting rounds down.
  const int ix = static_cast<int>(px + kPatch) - kPatch;
  const int iy = static_cast<int>(py + kPatch) - kPatch;
  pair.right = px - static_cast<float>(ix);
  pair.down = py - static_cast<float>(iy);
  pair.there = there + iy * pitch + ix;
}

/// One pass over all patches, forwards or back: each tries what its neighbours behind it have, then
/// descends.
CAMBER_TARGET_CLONES("avx2")
void search_pass(const float* here, const float* by_x, const float* by_y, const float* there,
                 std::ptrdiff_t pitch, bool forwards, int most_steps, PatchGrid& grid) {
  const int step = forwards ? 1 : -1;
  const int first_row_of = forwards ? 0 : grid.rows - 1;
  const int first_column_of = forwards ? 0 : grid.columns - 1;
  for (int r = first_row_of; r >= 0 && r < grid.rows; r += step) {
    for (int c = first_column_of; c >= 0 && c < grid.columns; c += step) {
      const std::ptrdiff_t i = static_cast<std::ptrdiff_t>(r) * grid.columns + c;
      if (!grid.wanted[static_cast<std::size_t>(i)]) continue;
      float* const u = grid.u.data() + i;
      float* const v = grid.v.data() + i;
      const int x = grid.left(c), y = grid.top(r);
      const std::ptrdiff_t at = y * pitch + x;
      PatchPair pair{here + at, nullptr, pitch, pitch, 0.0F, 0.0F};
      float best_u = *u, best_v = *v;
      place(grid, there, pitch, x, y, best_u, best_v, pair);
      float least = squared_difference(pair);
      const auto consider = [&](float cu, float cv) __attribute__((always_inline)) {
        place(grid, there, pitch, x, y, cu, cv, pair);
        const float squared = squared_difference(pair);
        if (squared < least) {
          least = squared;
          best_u = cu;
          best_v = cv;
        }
      };
      if (!grid.start_u.empty()) {
        consider(grid.start_u[static_cast<std::size_t>(i)],
                 grid.start_v[static_cast<std::size_t>(i)]);
      }
      if (c != first_column_of) consider(u[-step], v[-step]);
      if (r != first_row_of) consider(u[-step * grid.columns], v[-step * grid.columns]);
      const float from_u = best_u, from_v = best_v;

      const PatchNormal& n = grid.normal[static_cast<std::size_t>(i)];
      const float* gx = by_x + at;
      const float* gy = by_y + at;
      float at_u = best_u, at_v = best_v;
      least = 1e30F;
      for (int k = 0; k < most_steps; ++k) {
        place(grid, there, pitch, x, y, at_u, at_v, pair);
        F8 above, d, dx, dy, sum = {}, squares = {}, sum_x = {}, sum_y = {};
        first_row(pair, above);
        for (int row = 0; row < kPatch; ++row) {
          difference_row(pair, row, above, d);
          load(gx + row * pitch, dx);
          load(gy + row * pitch, dy);
          sum += d;
          squares += d * d;
          sum_x += d * dx;
          sum_y += d * dy;
        }
        const float s = sum_of(sum);
        const float squared = sum_of(squares) - s * s / kPatchPixels;
        if (!(squared < least)) break;
        least = squared;
        best_u = at_u;
        best_v = at_v;
        const float bx = sum_of(sum_x) - s * n.sum_x / kPatchPixels;
        const float by = sum_of(sum_y) - s * n.sum_y / kPatchPixels;
        const float step_u = kStepShare * n.inverse_determinant * (n.yy * bx - n.xy * by);
        const float step_v = kStepShare * n.inverse_determinant * (n.xx * by - n.xy * bx);
        at_u -= step_u;
        at_v -= step_v;
        if (step_u * step_u + step_v * step_v < kConverged * kConverged) {
          best_u = at_u;
          best_v = at_v;
          break;
        }
      }
      // What ran away by more than a patch found something else.
      const float off_u = best_u - from_u, off_v = best_v - from_v;
      const bool near = off_u * off_u + off_v * off_v <= kPatchPixels;
      *u = near ? best_u : from_u;
      *v = near ? best_v : from_v;
    }
  }
}

CAMBER_TARGET_CLONES("avx2")
void find_normals(const float* by_x, const float* by_y, std::ptrdiff_t pitch, PatchGrid& grid) {
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const std::size_t i = static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.columns) +
                            static_cast<std::size_t>(c);
      if (!grid.wanted[i]) continue;
      const std::ptrdiff_t at = grid.top(r) * pitch + grid.left(c);
      normal_of(by_x + at, by_y + at, pitch, grid.normal[i]);
    }
  }
}

/// Sums over the patches that cover a pixel: weights, and flows times weights.
struct WeightedFlow {
  std::vector<float> weight, u, v;
};

CAMBER_TARGET_CLONES("avx2")
void add_patches(const float* here, const float* there, std::ptrdiff_t pitch, const PatchGrid& grid,
                 float* weights, float* us, float* vs) {
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const std::size_t i = static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.columns) +
                            static_cast<std::size_t>(c);
      if (!grid.wanted[i]) continue;
      const int x = grid.left(c), y = grid.top(r);
      const float u = grid.u[i], v = grid.v[i];
      PatchPair pair{here + y * pitch + x, nullptr, pitch, pitch, 0.0F, 0.0F};
      place(grid, there, pitch, x, y, u, v, pair);
      F8 above, d;
      first_row(pair, above);
      for (int row = 0; row < kPatch; ++row) {
        difference_row(pair, row, above, d);
        const std::ptrdiff_t to = static_cast<std::ptrdiff_t>(y + row) * grid.width + x;
        const F8 size = d < 0.0F ? -d : d;
        const F8 weight = 1.0F / (size > 1.0F ? size : F8{} + 1.0F);
        F8 w, su, sv;
        load(weights + to, w);
        load(us + to, su);
        load(vs + to, sv);
        w += weight;
        su += weight * u;
        sv += weight * v;
        std::memcpy(weights + to, &w, sizeof(F8));
        std::memcpy(us + to, &su, sizeof(F8));
        std::memcpy(vs + to, &sv, sizeof(F8));
      }
    }
  }
}

CAMBER_TARGET_CLONES("avx2")
void sobel_row(int count, const float* above, const float* here, const float* below, float* by_x,
               float* by_y) {
  for (int x = 0; x < count; ++x) {
    by_x[x] = 0.125F * ((above[x + 1] - above[x - 1]) + 2.0F * (here[x + 1] - here[x - 1]) +
                        (below[x + 1] - below[x - 1]));
    by_y[x] = 0.125F * ((below[x - 1] - above[x - 1]) + 2.0F * (below[x] - above[x]) +
                        (below[x + 1] - above[x + 1]));
  }
}

void repeat_rim(FlowPyramid::Level* level) {
  constexpr int kBorder = FlowPyramid::kBorder;
  for (int y = 0; y < level->height; ++y) {
    float* row = level->intensity.ptr<float>() + level->at(0, y);
    std::fill(row - kBorder, row, row[0]);
    std::fill(row + level->width, row + level->width + kBorder, row[level->width - 1]);
  }
  const auto pitch = level->pitch();
  float* first = level->intensity.ptr<float>() + level->at(-kBorder, 0);
  float* last = level->intensity.ptr<float>() + level->at(-kBorder, level->height - 1);
  for (int y = 1; y <= kBorder; ++y) {
    std::copy(first, first + pitch, first - y * pitch);
    std::copy(last, last + pitch, last + y * pitch);
  }
}

void find_gradients(FlowPyramid::Level* level) {
  level->by_x.create(level->intensity.size(), CV_32FC1);  // the border is not looked at
  level->by_y.create(level->intensity.size(), CV_32FC1);
  const auto pitch = level->pitch();
  for (int y = 0; y < level->height; ++y) {
    const std::ptrdiff_t at = level->at(0, y);
    const float* row = level->intensity.ptr<float>() + at;
    sobel_row(level->width, row - pitch, row, row + pitch, level->by_x.ptr<float>() + at,
              level->by_y.ptr<float>() + at);
  }
}

FlowPyramid::Level empty_level(int width, int height) {
  FlowPyramid::Level out;
  out.width = width;
  out.height = height;
  out.intensity.create(height + 2 * FlowPyramid::kBorder, static_cast<int>(out.pitch()), CV_32FC1);
  return out;
}

/// Means over squares of 2^scale pixels; what is left over at the right and the bottom is dropped.
template <class Value, class Sum>
FlowPyramid::Level reduced(const cv::Mat& image, int scale) {
  const int side = 1 << scale;
  FlowPyramid::Level out = empty_level(image.cols / side, image.rows / side);
  const float share = 1.0F / static_cast<float>(side * side);
  std::vector<Sum> sums(static_cast<std::size_t>(out.width * side));
  for (int y = 0; y < out.height; ++y) {
    std::fill(sums.begin(), sums.end(), Sum{});
    for (int k = 0; k < side; ++k) {
      const Value* from = image.ptr<Value>(y * side + k);
      for (std::size_t x = 0; x < sums.size(); ++x) sums[x] += from[x];
    }
    float* to = out.intensity.ptr<float>() + out.at(0, y);
    for (int x = 0; x < out.width; ++x) {
      Sum sum{};
      for (int k = 0; k < side; ++k) sum += sums[static_cast<std::size_t>(x * side + k)];
      to[x] = share * static_cast<float>(sum);
    }
  }
  return out;
}

FlowPyramid::Level halved(const FlowPyramid::Level& fine) {
  FlowPyramid::Level out = empty_level(fine.width / 2, fine.height / 2);
  for (int y = 0; y < out.height; ++y) {
    const float* a = fine.intensity.ptr<float>() + fine.at(0, 2 * y);
    const float* b = a + fine.pitch();
    float* to = out.intensity.ptr<float>() + out.at(0, y);
    for (int x = 0; x < out.width; ++x) {
      to[x] = 0.25F * ((a[2 * x] + a[2 * x + 1]) + (b[2 * x] + b[2 * x + 1]));
    }
  }
  return out;
}

/// Bilinear, of the rim outside.
cv::Point2f sampled(const cv::Mat& field, float x, float y) {
  const float cx = std::min(std::max(x, 0.0F), static_cast<float>(field.cols - 1));
  const float cy = std::min(std::max(y, 0.0F), static_cast<float>(field.rows - 1));
  const int x0 = std::min(static_cast<int>(cx), std::max(0, field.cols - 2));
  const int y0 = std::min(static_cast<int>(cy), std::max(0, field.rows - 2));
  const int x1 = std::min(x0 + 1, field.cols - 1), y1 = std::min(y0 + 1, field.rows - 1);
  const float s = cx - static_cast<float>(x0), t = cy - static_cast<float>(y0);
  const auto* a = field.ptr<cv::Point2f>(y0);
  const auto* b = field.ptr<cv::Point2f>(y1);
  return (1 - t) * ((1 - s) * a[x0] + s * a[x1]) + t * ((1 - s) * b[x0] + s * b[x1]);
}

/// The next finer level's flow at a place of it, by the coarser one's.
cv::Point2f from_coarser(const cv::Mat& coarse, float x, float y) {
  return 2.0F * sampled(coarse, 0.5F * (x + 0.5F) - 0.5F, 0.5F * (y + 0.5F) - 0.5F);
}

void choose_patches(const std::uint8_t* wanted, const cv::Size& image, int scale, PatchGrid* grid) {
  const int side = 1 << scale;
  // Whether a block of pixels of this level has any of interest, by running sums over the image.
  std::vector<int> sums(static_cast<std::size_t>(grid->width + 1) *
                        static_cast<std::size_t>(grid->height + 1));
  const auto columns = static_cast<std::size_t>(grid->width + 1);
  for (int y = 0; y < grid->height; ++y) {
    int row = 0;
    for (int x = 0; x < grid->width; ++x) {
      for (int k = 0; k < side; ++k) {
        const std::uint8_t* from =
            wanted +
            static_cast<std::size_t>(y * side + k) * static_cast<std::size_t>(image.width) +
            static_cast<std::size_t>(x * side);
        for (int j = 0; j < side; ++j) row += from[j] != 0;
      }
      const std::size_t at =
          static_cast<std::size_t>(y + 1) * columns + static_cast<std::size_t>(x);
      sums[at + 1] = sums[at + 1 - columns] + row;
    }
  }
  for (int r = 0; r < grid->rows; ++r) {
    for (int c = 0; c < grid->columns; ++c) {
      const auto x = static_cast<std::size_t>(grid->left(c)),
                 y = static_cast<std::size_t>(grid->top(r));
      const std::size_t a = y * columns + x, b = (y + kPatch) * columns + x;
      grid->wanted[static_cast<std::size_t>(r) * static_cast<std::size_t>(grid->columns) +
                   static_cast<std::size_t>(c)] =
          sums[b + kPatch] - sums[b] - sums[a + kPatch] + sums[a] > 0;
    }
  }
}

}  // namespace

FlowPyramid::FlowPyramid(const cv::Mat& image, int finest_scale, bool gradients)
    : size_(image.size()), finest_scale_(finest_scale) {
  // The coarsest looks for motions up to a quarter of the image.
  const int most =
      static_cast<int>(std::log2(std::max(image.cols, image.rows) / (4.0 * kPatch)) + 0.5);
  const int least_side = std::min(image.cols, image.rows);
  if (least_side < kPatch) return;
  while (least_side >> finest_scale_ < kPatch) --finest_scale_;
  const int deepest = static_cast<int>(std::log2(least_side / kPatch));
  const int coarsest = std::max(finest_scale_, std::min(most, deepest));
  levels_.push_back(image.depth() == CV_8U ? reduced<std::uint8_t, int>(image, finest_scale_)
                                           : reduced<float, float>(image, finest_scale_));
  repeat_rim(&levels_.back());
  for (int k = finest_scale_ + 1; k <= coarsest; ++k) {
    levels_.push_back(halved(levels_.back()));
    repeat_rim(&levels_.back());
  }
  if (!gradients) return;
  for (Level& level : levels_) find_gradients(&level);
}

cv::Point2f DenseFlow::at(float x, float y) const {
  const auto factor = static_cast<float>(1 << scale_);
  return factor * sampled(field_, (x + 0.5F) / factor - 0.5F, (y + 0.5F) / factor - 0.5F);
}

DenseFlow DenseFlow::followed_by(const DenseFlow& second) const {
  const auto factor = static_cast<float>(1 << scale_);
  cv::Mat out(field_.size(), CV_32FC2);
  for (int y = 0; y < out.rows; ++y) {
    const auto* from = field_.ptr<cv::Point2f>(y);
    auto* to = out.ptr<cv::Point2f>(y);
    for (int x = 0; x < out.cols; ++x) {
      const float u = factor * (static_cast<float>(x) + from[x].x + 0.5F) - 0.5F;
      const float v = factor * (static_cast<float>(y) + from[x].y + 0.5F) - 0.5F;
      to[x] = from[x] + (1.0F / factor) * second.at(u, v);
    }
  }
  return {std::move(out), scale_};
}

DenseFlow inverse_search_flow(const FlowPyramid& from, const FlowPyramid& to,
                              const InverseSearchOptions& options, const DenseFlow& start,
                              const std::uint8_t* wanted) {
  cv::Mat coarse;
  if (from.levels().empty()) return {cv::Mat(from.size(), CV_32FC2, cv::Scalar(0.0, 0.0)), 0};
  for (std::size_t k = from.levels().size(); k-- > 0;) {
    const FlowPyramid::Level& a = from.levels()[k];
    const FlowPyramid::Level& b = to.levels()[k];
    const int scale = from.finest_scale() + static_cast<int>(k);
    PatchGrid grid(a.width, a.height, options.patch_stride);
    if (wanted) choose_patches(wanted, from.size(), scale, &grid);
    const auto factor = static_cast<float>(1 << scale);
    if (!start.empty()) {
      grid.start_u.resize(grid.u.size());
      grid.start_v.resize(grid.u.size());
    }
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const std::size_t i = static_cast<std::size_t>(r) * static_cast<std::size_t>(grid.columns) +
                              static_cast<std::size_t>(c);
        const float x = static_cast<float>(grid.left(c)) + 0.5F * (kPatch - 1);
        const float y = static_cast<float>(grid.top(r)) + 0.5F * (kPatch - 1);
        const cv::Point2f f = coarse.empty() ? cv::Point2f() : from_coarser(coarse, x, y);
        grid.u[i] = f.x;
        grid.v[i] = f.y;
        if (start.empty()) continue;
        const cv::Point2f s =
            (1.0F / factor) * start.at(factor * (x + 0.5F) - 0.5F, factor * (y + 0.5F) - 0.5F);
        grid.start_u[i] = s.x;
        grid.start_v[i] = s.y;
      }
    }
    const float* here = a.pixels(a.intensity);
    const float* there = b.pixels(b.intensity);
    find_normals(a.pixels(a.by_x), a.pixels(a.by_y), a.pitch(), grid);
    for (const bool forwards : {true, false}) {
      search_pass(here, a.pixels(a.by_x), a.pixels(a.by_y), there, a.pitch(), forwards,
                  options.most_steps, grid);
    }
    const auto pixels = static_cast<std::size_t>(a.width) * static_cast<std::size_t>(a.height);
    std::vector<float> weight(pixels, 0.0F), u(pixels, 0.0F), v(pixels, 0.0F);
    add_patches(here, there, a.pitch(), grid, weight.data(), u.data(), v.data());
    cv::Mat dense(a.height, a.width, CV_32FC2);
    for (int y = 0; y < a.height; ++y) {
      auto* row = dense.ptr<cv::Point2f>(y);
      const std::size_t first = static_cast<std::size_t>(y) * static_cast<std::size_t>(a.width);
      for (int x = 0; x < a.width; ++x) {
        const std::size_t i = first + static_cast<std::size_t>(x);
        if (weight[i] > 0.0F) {
          row[x] = {u[i] / weight[i], v[i] / weight[i]};
        } else {
          row[x] = coarse.empty()
                       ? cv::Point2f()
                       : from_coarser(coarse, static_cast<float>(x), static_cast<float>(y));
        }
      }
    }
    coarse = std::move(dense);
  }
  return {std::move(coarse), from.finest_scale()};
}

}  // namespace camber::detail
