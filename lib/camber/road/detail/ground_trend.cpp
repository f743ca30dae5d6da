#include "camber/road/detail/ground_trend.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"

namespace camber::detail {
namespace {

/// The lowest height of a block of cells, and where it is.
struct BlockLowest {
  float x, y;  // cells, from the grid's corner to the middle of the cell
  float z;     // m; kNoHeight: none
};

/// A plane about a node: z = height + slope_x * (x - node's x) + ...
struct NodePlane {
  float height = kNoHeight;              // m; kNoHeight: none
  float slope_x = 0.0f, slope_y = 0.0f;  // m a cell
};

class TrendMaker {
 public:
  TrendMaker(const HeightGrid& lowest, float cell, const TrendSizes& sizes, int num_threads)
      : lowest_(lowest), cell_(cell), sizes_(sizes), num_threads_(num_threads) {}

  HeightGrid make() {
    find_blocks();
    fit_nodes();
    return blend();
  }

 private:
  void find_blocks();
  void fit_nodes();
  /// Memory for the work at a node.
  struct Space {
    std::vector<BlockLowest> near;
    std::vector<int> lattice;  // numbers of near blocks, row by row of the window; -1: none
    std::vector<float> values;
  };
  void collect(int node_x, int node_y, Space& space) const;
  NodePlane fit(int node_x, int node_y, Space& space) const;
  HeightGrid blend() const;

  const HeightGrid& lowest_;
  const float cell_;
  const TrendSizes sizes_;
  const int num_threads_;
  int blocks_wide_ = 0, blocks_high_ = 0;
  std::vector<BlockLowest> blocks_;
  int nodes_wide_ = 0, nodes_high_ = 0;  // at multiples of the spacing, both borders among them
  std::vector<NodePlane> nodes_;
};

void TrendMaker::find_blocks() {
  const int side = sizes_.block;
  blocks_wide_ = lowest_.width / side;
  blocks_high_ = lowest_.height / side;
  blocks_.assign(as_size(blocks_wide_) * as_size(blocks_high_), {0.0f, 0.0f, kNoHeight});
  for (int y = 0; y < blocks_high_ * side; ++y) {
    const float* const row = lowest_.row(y);
    BlockLowest* const blocks = blocks_.data() + as_size(y / side) * as_size(blocks_wide_);
    for (int x = 0; x < blocks_wide_ * side; ++x) {
      BlockLowest& block = blocks[x / side];
      if (!(row[x] < block.z)) continue;
      block = {static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, row[x]};
    }
  }
}

float median_of(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Eigen::Vector2f held_to(const Eigen::Vector2f& slope, float steepest) {
  const float norm = slope.norm();
  return norm > steepest ? Eigen::Vector2f(slope * (steepest / norm)) : slope;
}

/// The median slope between blocks side by side, m a cell: steps onto what stands on the ground are
/// few (Theil, Sen). 0 where there are none side by side.
/// @param lattice  numbers of blocks among `near`, row by row; -1: none
Eigen::Vector2f median_slopes(const std::vector<BlockLowest>& near, const std::vector<int>& lattice,
                              int width, float side, std::vector<float>& space) {
  Eigen::Vector2f out(0.0f, 0.0f);
  for (int axis = 0; axis < 2; ++axis) {
    space.clear();
    const int next = axis == 0 ? 1 : width;
    for (int i = 0; i + next < static_cast<int>(lattice.size()); ++i) {
      if (axis == 0 && (i + 1) % width == 0) continue;
      if (lattice[as_size(i)] < 0 || lattice[as_size(i + next)] < 0) continue;
      const BlockLowest &a = near[as_size(lattice[as_size(i)])],
                        &b = near[as_size(lattice[as_size(i + next)])];
      const float along = axis == 0 ? b.x - a.x : b.y - a.y;
      // Lowest places are anywhere in their blocks.
      if (along >= 0.5f * side) space.push_back((b.z - a.z) / along);
    }
    if (!space.empty()) out[axis] = median_of(space);
  }
  return out;
}

/// The height of a plane of given slopes over the node that enough blocks share and few are below.
float low_height(const std::vector<BlockLowest>& near, const Eigen::Vector2f& slope, float scatter,
                 std::vector<float>& space) {
  constexpr float kShare = 0.15f;  // of the blocks
  const float within = 3.0f * scatter;
  space.clear();
  for (const BlockLowest& block : near) {
    space.push_back(block.z - slope.x() * block.x - slope.y() * block.y);
  }
  std::sort(space.begin(), space.end());
  const auto enough = static_cast<std::size_t>(kShare * static_cast<float>(space.size()));
  for (std::size_t i = 0; i + enough < space.size(); ++i) {
    if (space[i + enough] - space[i] <= within) return space[i + enough / 2];
  }
  return space[space.size() / 2];
}

/// Of a plane the height over the node and slopes: iteratively reweighted least squares, in which
/// what stands above counts the less the higher it is.
/// @param window  cells to each side of the node
Eigen::Vector3f hug_from_below(const std::vector<BlockLowest>& near, Eigen::Vector3f plane,
                               float window, float steepest, float scatter,
                               std::vector<float>& space) {
  const float hold = 0.02f * window * window;  // cells^2, weight of slopes as they were
  constexpr int kRounds = 4;
  constexpr float kSame = 0.02f;  // of the scatter, by which a height may still change
  // Few lie far below, and are reflections.
  const float deepest = 6.0f * scatter;
  float scale = 3.0f * scatter;
  for (int round = 0; round < kRounds; ++round) {
    float n = 0, x = 0, y = 0, z = 0, xx = 0, xy = 0, yy = 0, xz = 0, yz = 0;
    for (const BlockLowest& block : near) {
      const float above = block.z - (plane(0) + plane(1) * block.x + plane(2) * block.y);
      const float far = above > 0.0f ? above / scale : above / -deepest;
      const float weight = far <= 1.0f ? 1.0f : 1.0f / (far * far);
      const float wx = weight * block.x, wy = weight * block.y, wz = weight * block.z;
      n += weight;
      x += wx;
      y += wy;
      z += wz;
      xx += wx * block.x;
      xy += wx * block.y;
      yy += wy * block.y;
      xz += wx * block.z;
      yz += wy * block.z;
    }
    // Where blocks lie in one line, slopes across it stay what they were.
    const float vxx = xx / n - x / n * (x / n) + hold, vxy = xy / n - x / n * (y / n),
                vyy = yy / n - y / n * (y / n) + hold,
                vxz = xz / n - x / n * (z / n) + hold * plane(1),
                vyz = yz / n - y / n * (z / n) + hold * plane(2);
    const float determinant = vxx * vyy - vxy * vxy;
    const Eigen::Vector2f slope = held_to(
        {(vxz * vyy - vyz * vxy) / determinant, (vyz * vxx - vxz * vxy) / determinant}, steepest);
    const Eigen::Vector3f before = plane;
    plane << (z - slope.x() * x - slope.y() * y) / n, slope.x(), slope.y();
    space.clear();
    for (const BlockLowest& block : near) {
      const float above = block.z - (plane(0) + plane(1) * block.x + plane(2) * block.y);
      if (above <= 0.0f) space.push_back(-above);
    }
    const float last_scale = scale;
    scale = space.empty() ? scatter : std::max(scatter, median_of(space));
    const Eigen::Vector3f change = (plane - before).cwiseAbs();
    if (scale == last_scale && change(0) + window * (change(1) + change(2)) < kSame * scatter) {
      break;
    }
  }
  return plane;
}

/// How badly a plane goes below the blocks: what stands above counts up to a bound, what lies
/// below, as no ground does, up to a larger one.
float misfit(const std::vector<BlockLowest>& near, const Eigen::Vector3f& plane, float scatter) {
  const float high = 3.0f * scatter, low = 12.0f * scatter;
  float sum = 0.0f;
  for (const BlockLowest& block : near) {
    const float above = block.z - plane.dot(Eigen::Vector3f(1.0f, block.x, block.y));
    sum += above > 0.0f ? std::min(above, high) : std::min(-above, low);
  }
  return sum;
}

NodePlane TrendMaker::fit(int node_x, int node_y, Space& space) const {
  constexpr float kSteepest = 1.0f;  // rise over run
  std::vector<BlockLowest>& near = space.near;
  collect(node_x, node_y, space);
  NodePlane out;
  if (near.empty()) return out;
  const float base = near.front().z;
  for (BlockLowest& block : near) block.z -= base;
  const float window = static_cast<float>(sizes_.window()), steepest = kSteepest * cell_;
  // From the slope that most have, and where that is not level from a level start, too: roofs have
  // slopes as well.
  const Eigen::Vector2f common =
      held_to(median_slopes(near, space.lattice, 2 * sizes_.window() / sizes_.block,
                            static_cast<float>(sizes_.block), space.values),
              steepest);
  const auto from = [&](const Eigen::Vector2f& slope) {
    const Eigen::Vector3f start(low_height(near, slope, sizes_.scatter, space.values), slope.x(),
                                slope.y());
    return hug_from_below(near, start, window, steepest, sizes_.scatter, space.values);
  };
  Eigen::Vector3f plane = from(common);
  if (common.norm() * window > sizes_.scatter) {
    const Eigen::Vector3f level = from({0.0f, 0.0f});
    if (misfit(near, level, sizes_.scatter) <= misfit(near, plane, sizes_.scatter)) plane = level;
  }
  out.height = base + plane(0);
  out.slope_x = plane(1);
  out.slope_y = plane(2);
  return out;
}

/// The blocks about a node, places relative to it.
void TrendMaker::collect(int node_x, int node_y, Space& space) const {
  const int around = sizes_.window() / sizes_.block;
  const int bx = node_x / sizes_.block, by = node_y / sizes_.block;
  space.near.clear();
  space.lattice.clear();
  for (int y = by - around; y < by + around; ++y) {
    for (int x = bx - around; x < bx + around; ++x) {
      space.lattice.push_back(-1);
      if (x < 0 || y < 0 || x >= blocks_wide_ || y >= blocks_high_) continue;
      BlockLowest block = blocks_[as_size(y) * as_size(blocks_wide_) + as_size(x)];
      if (block.z == kNoHeight) continue;
      block.x -= static_cast<float>(node_x);
      block.y -= static_cast<float>(node_y);
      space.lattice.back() = static_cast<int>(space.near.size());
      space.near.push_back(block);
    }
  }
}

void TrendMaker::fit_nodes() {
  const int spacing = sizes_.spacing();
  nodes_wide_ = lowest_.width / spacing + 1;
  nodes_high_ = lowest_.height / spacing + 1;
  nodes_.resize(as_size(nodes_wide_) * as_size(nodes_high_));
  parallel_for(as_size(nodes_high_), num_threads_, [&](std::size_t row) {
    Space space;
    for (int x = 0; x < nodes_wide_; ++x) {
      nodes_[row * as_size(nodes_wide_) + as_size(x)] =
          fit(x * spacing, static_cast<int>(row) * spacing, space);
    }
  });
}

/// Heights of the blend of four planes along a row of cells between nodes.
CAMBER_TARGET_CLONES("avx2")
void blend_row(const float* weight, const float* height, const float* slope, int count,
               float* out) {
  // weight: of the left and right nodes at the first cell, and how the right one's grows.
  for (int i = 0; i < count; ++i) {
    const float at = static_cast<float>(i) + 0.5f;
    const float right = at * weight[0], left = 1.0f - right;
    const float on_left =
        weight[1] * (height[0] + slope[0] * at) + weight[2] * (height[2] + slope[2] * at);
    const float on_right =
        weight[1] * (height[1] + slope[1] * at) + weight[2] * (height[3] + slope[3] * at);
    out[i] = left * on_left + right * on_right;
  }
}

HeightGrid TrendMaker::blend() const {
  const int spacing = sizes_.spacing();
  HeightGrid out(lowest_.width, lowest_.height, kNoHeight);
  parallel_for(as_size(nodes_high_ - 1), num_threads_, [&](std::size_t node_row) {
    for (int node_x = 0; node_x + 1 < nodes_wide_; ++node_x) {
      const NodePlane* const upper =
          nodes_.data() + node_row * as_size(nodes_wide_) + as_size(node_x);
      const NodePlane* const lower = upper + nodes_wide_;
      const NodePlane* const corners[4] = {upper, upper + 1, lower, lower + 1};
      const auto known = [](const NodePlane* node) { return node->height != kNoHeight; };
      const int count = static_cast<int>(std::count_if(corners, corners + 4, known));
      if (count == 0) continue;
      for (int dy = 0; dy < spacing; ++dy) {
        const float v = static_cast<float>(dy) + 0.5f, share = v / static_cast<float>(spacing);
        float height[4], slope[4];
        for (int k = 0; k < 4; ++k) {
          const float down = k < 2 ? v : v - static_cast<float>(spacing);
          slope[k] = corners[k]->slope_x;
          height[k] = corners[k]->height + corners[k]->slope_y * down;
          if (k % 2 == 1) height[k] -= slope[k] * static_cast<float>(spacing);
        }
        float* const row =
            out.row(static_cast<int>(node_row) * spacing + dy) + as_size(node_x * spacing);
        if (count == 4) {
          const float weight[3] = {1.0f / static_cast<float>(spacing), 1.0f - share, share};
          blend_row(weight, height, slope, spacing, row);
          continue;
        }
        for (int dx = 0; dx < spacing; ++dx) {
          const float u = static_cast<float>(dx) + 0.5f, right = u / static_cast<float>(spacing);
          float sum = 0.0f, weights = 0.0f;
          for (int k = 0; k < 4; ++k) {
            if (!known(corners[k])) continue;
            const float weight =
                (k % 2 == 0 ? 1.0f - right : right) * (k < 2 ? 1.0f - share : share);
            sum += weight * (height[k] + slope[k] * u);
            weights += weight;
          }
          row[dx] = sum / weights;
        }
      }
    }
  });
  return out;
}

/// out = (a + 2 b + c) / 4.
CAMBER_TARGET_CLONES("avx2")
void smooth_lines(const float* a, const float* b, const float* c, std::size_t count, float* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = 0.25f * (a[i] + c[i]) + 0.5f * b[i];
}

CAMBER_TARGET_CLONES("avx2")
void take_off(const float* z, const float* trend, std::size_t count, float* off, float* weight) {
  for (std::size_t i = 0; i < count; ++i) {
    const bool known = z[i] < kNoHeight && trend[i] < kNoHeight;
    off[i] = known ? z[i] - trend[i] : 0.0f;
    weight[i] = known ? 1.0f : 0.0f;
  }
}

CAMBER_TARGET_CLONES("avx2")
void add_scaled(const float* values, float factor, std::size_t count, float* sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += factor * values[i];
}

/// @param held  weight of the trend alone
CAMBER_TARGET_CLONES("avx2")
void put_in_gaps(const float* trend, const float* off, const float* weight, const float* held,
                 std::size_t count, float* z) {
  for (std::size_t i = 0; i < count; ++i) {
    z[i] = z[i] < kNoHeight ? z[i] : trend[i] + off[i] / (weight[i] + held[i]);
  }
}

/// Cells to the last known one, at most one more than `most`.
CAMBER_TARGET_CLONES("avx2")
void step_on(const float* z, std::size_t count, std::int32_t most, std::int32_t* since) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t next = since[i] < most ? since[i] + 1 : most + 1;
    since[i] = z[i] < kNoHeight ? 0 : next;
  }
}

}  // namespace

TrendSizes TrendSizes::for_objects(float radius) {
  TrendSizes out;
  constexpr int kMost = 64;
  while (out.block < kMost && static_cast<float>(2 * out.block) < radius) out.block *= 2;
  return out;
}

HeightGrid ground_trend(const HeightGrid& lowest, float cell, const TrendSizes& sizes,
                        int num_threads) {
  return TrendMaker(lowest, cell, sizes, num_threads).make();
}

/// Spreads values by the kernel 1 2 1 with cells that are `step` apart, along rows, then columns;
/// beyond the border there is nothing.
void GapFiller::spread(HeightGrid& grid, int step) {
  const std::size_t w = as_size(grid.width), h = as_size(grid.height), s = as_size(step);
  line_.assign(w + 2 * s, 0.0f);
  for (std::size_t y = 0; y < h; ++y) {
    float* const row = grid.z.data() + y * w;
    std::copy_n(row, w, line_.begin() + static_cast<std::ptrdiff_t>(s));
    smooth_lines(line_.data(), line_.data() + s, line_.data() + 2 * s, w, row);
  }
  // Rows above that are still wanted, as they were.
  several_.assign((s + 1) * w, 0.0f);
  line_.assign(w, 0.0f);
  for (std::size_t y = 0; y < h; ++y) {
    float* const row = grid.z.data() + y * w;
    float* const above = several_.data() + (y % (s + 1)) * w;  // of y - s - 1, not wanted
    const float* const wanted = several_.data() + ((y + 1) % (s + 1)) * w;  // of y - s
    std::copy_n(row, w, above);
    const float* const below = y + s < h ? grid.z.data() + (y + s) * w : line_.data();
    smooth_lines(wanted, above, below, w, row);
  }
}

/// Weights of the trend: little between known cells of a row or a column, which a height is
/// interpolated from, more beyond the border.
void GapFiller::weigh_trend(const HeightGrid& grid) {
  constexpr float kBetween = 1e-8f, kBeyond = 1e-3f;
  const std::size_t w = as_size(grid.width), h = as_size(grid.height);
  held_.assign(grid.z.size(), kBeyond);
  before_.resize(grid.z.size());
  since_.assign(w, kReach + 1);
  // Down, then up: the rows above are known to be near in `before_`.
  for (std::size_t y = 0; y < h; ++y) {
    step_on(grid.z.data() + y * w, w, kReach, since_.data());
    std::copy_n(since_.begin(), w, before_.begin() + static_cast<std::ptrdiff_t>(y * w));
  }
  since_.assign(w, kReach + 1);
  for (std::size_t y = h; y-- > 0;) {
    step_on(grid.z.data() + y * w, w, kReach, since_.data());
    const std::int32_t* const before = before_.data() + y * w;
    float* const held = held_.data() + y * w;
    for (std::size_t x = 0; x < w; ++x) {
      if (before[x] <= kReach && since_[x] <= kReach) held[x] = kBetween;
    }
    const float* const z = grid.z.data() + y * w;
    std::size_t last = w;  // known cell
    for (std::size_t x = 0; x < w; ++x) {
      if (z[x] == kNoHeight) continue;
      if (last < x && x - last <= 2 * as_size(kReach)) {
        for (std::size_t k = last + 1; k < x; ++k) {
          if (k - last <= as_size(kReach) && x - k <= as_size(kReach)) held[k] = kBetween;
        }
      }
      last = x;
    }
  }
}

void GapFiller::fill(const HeightGrid& trend, HeightGrid& grid) {
  constexpr float kNarrower = 1.0f / 128.0f;  // weight of a level over that of the one before
  static_assert(kReach == 1 + 2 + 4, "three levels");
  for (HeightGrid* g : {&off_, &weight_, &sum_off_, &sum_weight_}) {
    g->width = grid.width;
    g->height = grid.height;
    g->z.resize(grid.z.size());
  }
  const std::size_t count = grid.z.size();
  take_off(grid.z.data(), trend.z.data(), count, off_.z.data(), weight_.z.data());
  std::fill(sum_off_.z.begin(), sum_off_.z.end(), 0.0f);
  std::fill(sum_weight_.z.begin(), sum_weight_.z.end(), 0.0f);
  weigh_trend(grid);
  float factor = 1.0f;
  for (const int step : {1, 2, 4}) {
    spread(off_, step);
    spread(weight_, step);
    add_scaled(off_.z.data(), factor, count, sum_off_.z.data());
    add_scaled(weight_.z.data(), factor, count, sum_weight_.z.data());
    factor *= kNarrower;
  }
  put_in_gaps(trend.z.data(), sum_off_.z.data(), sum_weight_.z.data(), held_.data(), count,
              grid.z.data());
}

}  // namespace camber::detail
