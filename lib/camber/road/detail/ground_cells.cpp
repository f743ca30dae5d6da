#include "camber/road/detail/ground_cells.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/road/detail/cell_lanes.h"

namespace camber::detail {
namespace {

constexpr std::size_t kBlock = 1024;  // points

/// Points of a block in the plan's frame, and which of them are usable.
struct PlanBlock {
  float u[kBlock], v[kBlock], h[kBlock];  // m
  std::int32_t usable[kBlock];
};

/// @param xyz   coordinates of n points, at most kBlock
/// @param axes  rows of the frame's axes
CAMBER_TARGET_CLONES("avx2")
void to_plan(const float* xyz, std::size_t n, const float* axes, PlanBlock& out) {
  for (std::size_t i = 0; i < n; ++i) {
    const float x = xyz[3 * i], y = xyz[3 * i + 1], z = xyz[3 * i + 2];
    const float u = axes[0] * x + (axes[1] * y + axes[2] * z),
                v = axes[3] * x + (axes[4] * y + axes[5] * z),
                h = axes[6] * x + (axes[7] * y + axes[8] * z);
    out.u[i] = u;
    out.v[i] = v;
    out.h[i] = h;
    out.usable[i] = std::abs(u) + std::abs(v) + std::abs(h) < kFarthest ? 1 : 0;
  }
}

/// Widens bounds by the usable points of a block. @return their number
CAMBER_TARGET_CLONES("avx2")
std::int32_t widen(const PlanBlock& block, std::size_t n, float* low, float* high) {
  float lu = low[0], lv = low[1], hu = high[0], hv = high[1];
  std::int32_t count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const float u = block.u[i], v = block.v[i];
    const bool usable = block.usable[i] != 0;
    const float below_u = usable ? u : kNoHeight, below_v = usable ? v : kNoHeight,
                above_u = usable ? u : -kNoHeight, above_v = usable ? v : -kNoHeight;
    lu = below_u < lu ? below_u : lu;
    lv = below_v < lv ? below_v : lv;
    hu = above_u > hu ? above_u : hu;
    hv = above_v > hv ? above_v : hv;
    count += block.usable[i];
  }
  low[0] = lu;
  low[1] = lv;
  high[0] = hu;
  high[1] = hv;
  return count;
}

/// A grid over the plan.
struct PlanGrid {
  float low[2], high[2];  // m, bounds of what is in it
  float corner[2];        // m
  float size, per_metre;  // m, of a cell; cells
  std::int32_t width, height;
};

/// The cell along an axis of a place, m from the grid's corner, which becomes that from the cell's
/// corner, in cells.
inline __attribute__((always_inline)) void cell_along(const PlanGrid& grid, std::int32_t cells,
                                                      F8& place, I8& cell) {
  const I8 none = {};
  cell = __builtin_convertvector(place * grid.per_metre, I8);
  F8 inside = place - __builtin_convertvector(cell, F8) * grid.size;
  // The product above is rounded: the difference decides.
  cell += (inside < 0.0f ? none - 1 : none) + (inside >= grid.size ? none + 1 : none);
  const I8 last = none + (cells - 1);
  cell = cell < last ? cell : last;
  cell = cell > none ? cell : none;
  inside = place - __builtin_convertvector(cell, F8) * grid.size;
  place = inside * grid.per_metre;
}

/// Puts a block's points in cells: coordinates become those in cells from their cell's corner.
/// @param cell  of each point, with room for kBlock; -1: not in the grid
CAMBER_TARGET_CLONES("avx2")
void to_cells(const PlanGrid& grid, std::size_t n, PlanBlock& block, std::int32_t* cell) {
  const I8 none = {};
  for (std::size_t i = 0; i < n; i += 8) {
    F8 u, v;
    I8 usable;
    std::memcpy(&u, block.u + i, sizeof u);
    std::memcpy(&v, block.v + i, sizeof v);
    std::memcpy(&usable, block.usable + i, sizeof usable);
    const I8 inside = (usable != none) & (u >= grid.low[0]) & (u <= grid.high[0]) &
                      (v >= grid.low[1]) & (v <= grid.high[1]);
    u = inside ? u - grid.corner[0] : F8{};
    v = inside ? v - grid.corner[1] : F8{};
    I8 x, y;
    cell_along(grid, grid.width, u, x);
    cell_along(grid, grid.height, v, y);
    const I8 place = inside ? y * grid.width + x : none - 1;
    std::memcpy(block.u + i, &u, sizeof u);
    std::memcpy(block.v + i, &v, sizeof v);
    std::memcpy(cell + i, &place, sizeof place);
  }
}

/// Calls visit(first, n, block) for points [begin, end) of a cloud in blocks, in the plan's frame.
template <typename Visit>
void for_each_block(const RoadCloud& cloud, const PlanFrame& frame, std::size_t begin,
                    std::size_t end, const Visit& visit) {
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> axes = frame.axes;
  PlanBlock block;
  for (std::size_t first = begin; first < end; first += kBlock) {
    const std::size_t n = std::min(kBlock, end - first);
    to_plan(cloud.points[first].data(), n, axes.data(), block);
    for (std::size_t i = n; i < (n + 7) / 8 * 8; ++i) block.u[i] = block.v[i] = 0.0f;
    visit(first, n, block);
  }
}

/// What one thread sorts: the points [first, last) that lie in the cells [first_cell, last_cell).
struct Share {
  std::size_t first = 0, last = 0;
  std::int32_t first_cell = 0, last_cell = 0;
};

/// Shares of a cloud that the caches hold: its points, by parts; each needs a table of its own.
/// What takes time with larger clouds is that cells lie far apart in memory: there each share is a
/// slice of the grid, for which all points are looked at.
std::vector<Share> make_shares(std::size_t points, std::size_t cells, int num_threads) {
  constexpr std::size_t kFewest = 32768, kFewestOfSlice = 262144, kMost = 4;
  const std::size_t threads = std::min(kMost, as_size(resolve_num_threads(num_threads)));
  const std::size_t slices = std::clamp<std::size_t>(points / kFewestOfSlice, 1, threads);
  const bool by_points = slices == 1 && cells <= points;
  const std::size_t count =
      by_points ? std::clamp<std::size_t>(points / kFewest, 1, threads) : slices;
  std::vector<Share> shares(count);
  for (std::size_t k = 0; k < count; ++k) {
    const auto begin = [&](std::size_t size, std::size_t i) { return size * i / count; };
    Share& share = shares[k];
    share.first = by_points ? begin(points, k) : 0;
    share.last = by_points ? begin(points, k + 1) : points;
    share.first_cell = by_points ? 0 : static_cast<std::int32_t>(begin(cells, k));
    share.last_cell = static_cast<std::int32_t>(by_points ? cells : begin(cells, k + 1));
  }
  return shares;
}

}  // namespace

PlanFrame::PlanFrame(const Eigen::Vector3d& direction) : up(direction.normalized()) {
  const Eigen::Vector3d along =
      std::abs(up.x()) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
  e1 = (along - up * up.dot(along)).normalized();
  e2 = up.cross(e1);
  axes.row(0) = e1.cast<float>();
  axes.row(1) = e2.cast<float>();
  axes.row(2) = up.cast<float>();
}

PlanBounds find_bounds(const RoadCloud& cloud, const PlanFrame& frame, int num_threads,
                       std::size_t* usable) {
  constexpr std::size_t kPiece = 32 * kBlock;
  struct Part {
    PlanBounds bounds;
    std::size_t usable = 0;
  };
  std::vector<Part> parts((cloud.size() + kPiece - 1) / kPiece);
  parallel_for(parts.size(), num_threads, [&](std::size_t piece) {
    Part& part = parts[piece];
    for_each_block(cloud, frame, piece * kPiece, std::min(cloud.size(), (piece + 1) * kPiece),
                   [&](std::size_t, std::size_t n, const PlanBlock& block) {
                     part.usable += as_size(widen(block, n, part.bounds.low, part.bounds.high));
                   });
  });
  PlanBounds out;
  *usable = 0;
  for (const Part& part : parts) {
    *usable += part.usable;
    for (int axis = 0; axis < 2; ++axis) {
      out.low[axis] = std::min(out.low[axis], part.bounds.low[axis]);
      out.high[axis] = std::max(out.high[axis], part.bounds.high[axis]);
    }
  }
  return out;
}

PlanBounds choose_bounds(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& all,
                         double most, double* cell) {
  const auto squares = [&](const PlanBounds& b) {
    return (b.width() / *cell + 1.0) * (b.height() / *cell + 1.0);
  };
  if (squares(all) <= most) return all;
  PlanBounds bounds = all;
  std::vector<float> values[2];
  for (std::size_t i = 0; i < cloud.size(); i += std::max<std::size_t>(1, cloud.size() / 100000)) {
    const Eigen::Vector3f q = frame(cloud.points[i]);
    if (!usable(q)) continue;
    values[0].push_back(q.x());
    values[1].push_back(q.y());
  }
  for (int axis = 0; axis < 2 && !values[0].empty(); ++axis) {
    const auto quantile = [&](double share) {
      std::vector<float>& v = values[axis];
      const auto at =
          v.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(v.size() - 1));
      std::nth_element(v.begin(), at, v.end());
      return *at;
    };
    const float low = quantile(0.005), high = quantile(0.995);
    const float margin = 0.5f * (high - low) + 10.0f;
    bounds.low[axis] = std::max(bounds.low[axis], low - margin);
    bounds.high[axis] = std::min(bounds.high[axis], high + margin);
  }
  while (squares(bounds) > most) *cell *= 1.25;
  return bounds;
}

GroundCells sort_by_cell(const RoadCloud& cloud, const PlanFrame& frame, const PlanBounds& bounds,
                         double size, int num_threads) {
  GroundCells cells;
  cells.cell = static_cast<float>(size);
  size = cells.cell;
  const double zero[2] = {-frame.e1.dot(cloud.origin), -frame.e2.dot(cloud.origin)};
  int sides[2];
  for (int axis = 0; axis < 2; ++axis) {
    const double first = std::floor((double{bounds.low[axis]} - zero[axis]) / size);
    cells.corner[axis] = zero[axis] + first * size;
    sides[axis] = static_cast<int>((bounds.high[axis] - cells.corner[axis]) / size) + 1;
  }
  cells.width = sides[0];
  cells.height = sides[1];
  cells.start.assign(cells.count() + 1, 0);
  const PlanGrid grid = {{bounds.low[0], bounds.low[1]},
                         {bounds.high[0], bounds.high[1]},
                         {static_cast<float>(cells.corner[0]), static_cast<float>(cells.corner[1])},
                         cells.cell,
                         1.0f / cells.cell,
                         cells.width,
                         cells.height};
  std::vector<Share> shares = make_shares(cloud.size(), cells.count(), num_threads);
  const bool by_points = shares.front().last < cloud.size();
  // Of each share of the points, or of all, and each cell: the number of points, then the place of
  // the next one. Either way points of a cell keep their order.
  std::vector<std::vector<int>> tables(by_points ? shares.size() : 1);
  for (std::vector<int>& table : tables) table.assign(cells.count(), 0);
  const auto for_each_share = [&](const auto& visit) {
    parallel_for(shares.size(), num_threads, [&](std::size_t k) {
      const Share& share = shares[k];
      int* const table = tables[by_points ? k : 0].data();
      alignas(32) std::int32_t cell[kBlock];
      for_each_block(cloud, frame, share.first, share.last,
                     [&](std::size_t from, std::size_t n, PlanBlock& block) {
                       to_cells(grid, n, block, cell);
                       for (std::size_t i = 0; i < n; ++i) {
                         if (cell[i] < share.first_cell || cell[i] >= share.last_cell) continue;
                         visit(from, i, block, table[cell[i]]);
                       }
                     });
    });
  };
  for_each_share([](std::size_t, std::size_t, const PlanBlock&, int& number) { ++number; });
  int count = 0;
  for (std::size_t c = 0; c < cells.count(); ++c) {
    cells.start[c] = count;
    for (std::vector<int>& table : tables) {
      const int number = table[c];
      table[c] = count;
      count += number;
    }
    if (count > cells.start[c]) cells.occupied.push_back(static_cast<int>(c));
  }
  cells.start.back() = count;
  if (!by_points) {
    // Slices with as many points each.
    for (std::size_t k = 1; k < shares.size(); ++k) {
      const auto place = std::lower_bound(cells.start.begin(), cells.start.end() - 1,
                                          static_cast<int>(as_size(count) * k / shares.size()));
      shares[k - 1].last_cell = shares[k].first_cell =
          static_cast<std::int32_t>(place - cells.start.begin());
    }
  }
  cells.points.resize(as_size(count));
  for_each_share([&](std::size_t first, std::size_t i, const PlanBlock& block, int& next) {
    cells.points[as_size(next++)] = {block.u[i], block.v[i], block.h[i],
                                     static_cast<int>(first + i)};
  });
  return cells;
}

void extend(GroundCells& cells, const PlanFrame& frame, const Eigen::Vector3d& origin, int margin,
            int multiple) {
  const double zero[2] = {-frame.e1.dot(origin), -frame.e2.dot(origin)};
  const int old[2] = {cells.width, cells.height};
  int before[2], sides[2];
  for (int axis = 0; axis < 2; ++axis) {
    const double size = cells.cell;
    const double first = std::round((cells.corner[axis] - zero[axis]) / size);
    const double begin = multiple * std::floor((first - margin) / multiple);
    const double end = multiple * std::ceil((first + old[axis] + margin) / multiple);
    before[axis] = static_cast<int>(first - begin);
    sides[axis] = static_cast<int>(end - begin);
    cells.corner[axis] = zero[axis] + begin * size;
  }
  const std::vector<int> start = std::move(cells.start);
  cells.width = sides[0];
  cells.height = sides[1];
  cells.start.resize(cells.count() + 1);
  auto next = cells.start.begin();
  next = std::fill_n(next, as_size(before[1]) * as_size(cells.width), 0);
  for (int y = 0; y < old[1]; ++y) {
    const auto row = start.begin() + static_cast<std::ptrdiff_t>(y) * old[0];
    next = std::fill_n(next, before[0], *row);
    next = std::copy_n(row, old[0], next);
    next = std::fill_n(next, cells.width - before[0] - old[0], row[old[0]]);
  }
  std::fill(next, cells.start.end(), start.back());
  for (int& c : cells.occupied) {
    c = (c / old[0] + before[1]) * cells.width + c % old[0] + before[0];
  }
}

std::vector<std::size_t> cell_runs(const GroundCells& cells) {
  constexpr int kPoints = 8192;
  std::vector<std::size_t> runs;
  int end = 0;  // point with which a new run begins
  for (std::size_t k = 0; k < cells.occupied.size(); ++k) {
    const int first = cells.start[as_size(cells.occupied[k])];
    if (k > 0 && first < end) continue;
    runs.push_back(k);
    end = first + kPoints;
  }
  runs.push_back(cells.occupied.size());
  return runs;
}

PointDensity measure_density(const GroundCells& cells) {
  const int w = (cells.width + 1) / 2, h = (cells.height + 1) / 2;
  std::vector<int> counts(as_size(w) * as_size(h), 0), occupied;
  for (const int c : cells.occupied) {
    counts[as_size(c / cells.width / 2) * as_size(w) + as_size(c % cells.width / 2)] +=
        cells.start[as_size(c) + 1] - cells.start[as_size(c)];
  }
  for (const int count : counts) {
    if (count > 0) occupied.push_back(count);
  }
  const auto middle = occupied.begin() + static_cast<std::ptrdiff_t>(occupied.size() / 2);
  std::nth_element(occupied.begin(), middle, occupied.end());
  const double area = 4.0 * static_cast<double>(cells.cell) * cells.cell;
  const double squares = static_cast<double>(occupied.size());
  return {*middle / area, static_cast<double>(cells.points.size()) / (squares * area),
          squares / static_cast<double>(counts.size())};
}

}  // namespace camber::detail
