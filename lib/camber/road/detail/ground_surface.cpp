#include "camber/road/detail/ground_surface.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/road/detail/cell_lanes.h"
#include "camber/road/detail/ground_trend.h"

namespace camber::detail {
namespace {

/// Finds the lowest height above `floor` in a cell that enough points share.
struct LowestMode {
  float height = kNoHeight;  // m, mean of those points
  int support = 0;           // their number
};

/// Of a cell's points above a floor and not above a ceiling.
struct HeightSums {
  float lowest, highest;  // m
  float sum, count;
};

CAMBER_TARGET_CLONES("avx2")
HeightSums sum_heights(const CellPoint* points, std::size_t count, float floor, float ceiling) {
  const F8 none = {};
  F8 lowest = none + kNoHeight, highest = none - kNoHeight, sum = {}, number = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    PointLanes p;
    load_lanes(points + i, count - i, p);
    const I8 used = (p.h > floor) & (p.h <= ceiling) & p.there;
    const F8 low = used ? p.h : none + kNoHeight, high = used ? p.h : none - kNoHeight;
    lowest = low < lowest ? low : lowest;
    highest = high > highest ? high : highest;
    sum += used ? p.h : none;
    number += used ? none + 1.0f : none;
  }
  return {least_of_lanes(lowest), -least_of_lanes(-highest), sum_of_lanes(sum),
          sum_of_lanes(number)};
}

LowestMode lowest_mode(const GroundCells& cells, std::size_t cell, float floor) {
  constexpr float kBin = 0.125f;  // m; two make a window
  constexpr int kBins = 96;
  constexpr float kShare = 0.15f;  // of the fullest window's points
  const CellPoint* const begin = cells.points.data() + cells.start[cell];
  const CellPoint* const end = cells.points.data() + cells.start[cell + 1];
  const std::size_t count = static_cast<std::size_t>(end - begin);
  const HeightSums all = sum_heights(begin, count, floor, kNoHeight);
  if (all.count == 0.0f) return {};
  const float lowest = all.lowest;
  const auto bin_of = [&](float height) {
    return std::min(static_cast<int>(std::min((height - lowest) / kBin, 1e4f)), kBins);
  };
  const auto mean_of = [](const HeightSums& sums) {
    return LowestMode{sums.sum / sums.count, static_cast<int>(sums.count)};
  };
  const int last = bin_of(all.highest), windows = std::min(last + 1, kBins - 1);
  if (last <= 1) return mean_of(all);  // one window
  // Most cells reach over a few bins: the others need neither be cleared nor looked at.
  std::uint32_t bins[kBins + 2];
  std::fill_n(bins, last + 2, 0u);
  for (auto p = begin; p != end; ++p) {
    if (p->h > floor) ++bins[bin_of(p->h)];
  }
  std::uint32_t most = 0;
  for (int k = 0; k < windows; ++k) most = std::max(most, bins[k] + bins[k + 1]);
  const float enough = std::max(1.0f, kShare * static_cast<float>(most));
  for (int k = 0; k < windows; ++k) {
    if (static_cast<float>(bins[k] + bins[k + 1]) < enough) continue;
    const float from = lowest + static_cast<float>(k) * kBin;
    const float below = std::nextafter(from, -kNoHeight);
    const HeightSums inside = sum_heights(begin, count, std::max(below, floor), from + 2.0f * kBin);
    if (inside.count > 0.0f) return mean_of(inside);
  }
  return {lowest, 1};
}

constexpr int kAround = 3;  // cells to each side of one that is judged

/// Of the squares of 2 * kAround + 1 cells below and right of a place: how many cells are lower
/// than a bound, and how many hold a height.
struct SquareCounts {
  int lower = 0, known = 0;
};

CAMBER_TARGET_CLONES("avx2")
SquareCounts count_square(const float* place, std::size_t stride, float bound) {
  constexpr int kSide = 2 * kAround + 1, kLanes = 8;
  std::int32_t lower[kLanes] = {}, known[kLanes] = {};
  for (int row = 0; row < kSide; ++row) {
    const float* const from = place + static_cast<std::size_t>(row) * stride;
    for (int i = 0; i < kLanes; ++i) {
      lower[i] += from[i] < bound ? 1 : 0;
      known[i] += from[i] < kNoHeight ? 1 : 0;
    }
  }
  SquareCounts out;
  for (int i = 0; i < kSide; ++i) {
    out.lower += lower[i];
    out.known += known[i];
  }
  return out;
}

/// Heights with a margin of empty cells, so that squares around cells need no clipping.
class MarginGrid {
 public:
  explicit MarginGrid(const HeightGrid& grid)
      : stride_(as_size(grid.width) + 2 * kAround + 1),
        z_(stride_ * (as_size(grid.height) + 2 * kAround), kNoHeight) {
    for (int y = 0; y < grid.height; ++y) {
      std::copy_n(grid.row(y), grid.width, z_.begin() + static_cast<std::ptrdiff_t>(at(0, y)));
    }
  }
  void set(int x, int y, float height) { z_[at(x, y)] = height; }
  SquareCounts count(int x, int y, float bound) const {
    return count_square(z_.data() + at(x - kAround, y - kAround), stride_, bound);
  }

 private:
  std::size_t at(int x, int y) const {
    return as_size(y + kAround) * stride_ + as_size(x + kAround);
  }
  std::size_t stride_;  // one more, for a lane that is read and not counted
  std::vector<float> z_;
};

/// Calls visit(dx, dy, index) for the other cells around one that hold a height.
template <typename Visit>
void for_each_around(const HeightGrid& lowest, int cell, const Visit& visit) {
  const int cx = cell % lowest.width, cy = cell / lowest.width;
  for (int y = std::max(cy - kAround, 0); y <= std::min(cy + kAround, lowest.height - 1); ++y) {
    for (int x = std::max(cx - kAround, 0); x <= std::min(cx + kAround, lowest.width - 1); ++x) {
      const std::size_t other = lowest.at(x, y);
      if (other != as_size(cell) && lowest.z[other] != kNoHeight) visit(x - cx, y - cy, other);
    }
  }
}

/// Whether a cell of a scan from the air is lower than nearly all around it.
bool is_below_nearly_all(const GroundCells& cells, const HeightGrid& lowest, int cell) {
  int around = 0, as_low = 0;
  for_each_around(lowest, cell, [&](int dx, int dy, std::size_t other) {
    const float distance = static_cast<float>(std::max(std::abs(dx), std::abs(dy)));
    ++around;
    if (lowest.z[other] - lowest.z[as_size(cell)] < 1.0f + 0.6f * cells.cell * distance) ++as_low;
  });
  return around >= 4 && as_low <= 4;
}

/// Whether a cell lies below the plane through those around it, by more than a slope may do, and
/// few of these are as low.
/// @param around  the same heights
bool is_below_plane(const GroundCells& cells, const LowestHeights& heights,
                    const MarginGrid& around, int cell) {
  constexpr float kFew = 30.0f;       // points
  constexpr float kBelow = 0.3f;      // m, below the plane
  constexpr float kPerMetre = 0.15f;  // m, for each metre from the middle of the cells around
  constexpr float kAsDeep = 0.2f, kShare = 0.2f;  // m; of the cells around
  const HeightGrid& lowest = heights.heights;
  const std::size_t at = as_size(cell);
  const float z = lowest.z[at];
  // Ground between dense traffic is below that plane too, but is as low in more places. Asked
  // first, for it decides nearly all cells, and quickly.
  const SquareCounts counts = around.count(cell % cells.width, cell / cells.width, z + kAsDeep);
  const int others = counts.known - 1, as_deep = counts.lower - (z < z + kAsDeep ? 1 : 0);
  if (others < 4 || static_cast<float>(as_deep) > kShare * static_cast<float>(others)) return false;
  float s = 0, sx = 0, sy = 0, sz = 0, sxx = 0, sxy = 0, syy = 0, sxz = 0, syz = 0;
  for_each_around(lowest, cell, [&](int x, int y, std::size_t other) {
    const float dx = static_cast<float>(x), dy = static_cast<float>(y), dz = lowest.z[other] - z;
    const float weight = std::min(static_cast<float>(heights.support[other]), kFew);
    s += weight;
    sx += weight * dx;
    sy += weight * dy;
    sz += weight * dz;
    sxx += weight * dx * dx;
    sxy += weight * dx * dy;
    syy += weight * dy * dy;
    sxz += weight * dx * dz;
    syz += weight * dy * dz;
  });
  if (s < 4.0f * static_cast<float>(heights.support[at])) return false;
  const float mx = sx / s, my = sy / s, mz = sz / s;
  constexpr float kLevel = 0.2f;  // cells^2: held level where those around are in one line
  const float vxx = sxx / s - mx * mx + kLevel, vxy = sxy / s - mx * my,
              vyy = syy / s - my * my + kLevel, vxz = sxz / s - mx * mz, vyz = syz / s - my * mz;
  const float determinant = vxx * vyy - vxy * vxy;
  const float gx = (vxz * vyy - vyz * vxy) / determinant,
              gy = (vyz * vxx - vxz * vxy) / determinant;
  const float distance = cells.cell * std::sqrt(mx * mx + my * my);
  return mz - gx * mx - gy * my > kBelow + kPerMetre * distance;
}

/// The lowest height of each two by two cells.
HeightGrid halved(const HeightGrid& fine) {
  HeightGrid half((fine.width + 1) / 2, (fine.height + 1) / 2, kNoHeight);
  for (int y = 0; y < fine.height; ++y) {
    const float* const row = fine.row(y);
    float* const out = half.row(y / 2);
    for (int x = 0; x < fine.width; ++x) out[x / 2] = std::min(out[x / 2], row[x]);
  }
  return half;
}

/// Marks the cells that rise out of openings of the surface with growing squares. Large squares are
/// taken on a coarser grid.
/// @param surface  the lowest heights, gaps filled
std::vector<unsigned char> find_objects(const GroundCells& cells, const GroundRules& rules,
                                        const HeightGrid& lowest, HeightGrid surface) {
  std::vector<unsigned char> object(cells.count(), 0);
  HeightGrid eroded, opened;
  std::vector<float> space;
  const float reach = std::min(0.5f * rules.largest_object / cells.cell,  // cells
                               static_cast<float>(std::max(cells.width, cells.height)));
  int factor = 1;
  float last = 0.0f;
  for (float radius = 1.0f;; radius = std::max(radius + 1.0f, 1.4f * radius)) {
    const float r = std::min(radius, reach);
    if (r <= last) break;
    for (; r / static_cast<float>(factor) > 4.0f; factor *= 2) surface = halved(surface);
    const int window = std::max(1, static_cast<int>(std::lround(r / static_cast<float>(factor))));
    erode(surface, window, eroded, space);
    dilate(eroded, window, opened, space);
    const int slack = factor > 1 ? factor : 0;  // a coarse cell has the height of its lowest place
    const float limit = rules.slope * static_cast<float>(window * factor + slack) * cells.cell;
    for (const int c : cells.occupied) {
      const std::size_t at = as_size(c);
      if (lowest.z[at] == kNoHeight) continue;
      const int x = c % cells.width / factor, y = c / cells.width / factor;
      if (lowest.z[at] - opened.z[opened.at(x, y)] > limit) object[at] = 1;
    }
    last = r;
  }
  return object;
}

/// Takes out pieces of the surface that stand above what is around them on most of their border:
/// neighbouring cells whose heights agree, but for the slope of the ground, make a piece; pieces
/// smaller in area than the square of the largest object, and no longer than twice that along an
/// axis of the grid, are judged.
void remove_raised(const GroundCells& cells, const GroundRules& rules, const HeightGrid& filled,
                   HeightGrid& ground) {
  const int w = cells.width, h = cells.height;
  std::vector<Eigen::Vector2f> slopes(cells.count(), Eigen::Vector2f::Zero());
  const float steepest = 0.7f * cells.cell;
  for (const int c : cells.occupied) {
    if (ground.z[as_size(c)] == kNoHeight) continue;
    slopes[as_size(c)] = gradient(filled, c % w, c / w, 2).cwiseMax(-steepest).cwiseMin(steepest);
  }
  std::vector<int> parent(cells.count(), -1);  // of roots: minus the number of cells
  const auto root = [&](int c) {
    while (parent[as_size(c)] >= 0) {
      const int up = parent[as_size(c)];
      if (parent[as_size(up)] >= 0) parent[as_size(c)] = parent[as_size(up)];
      c = up;
    }
    return c;
  };
  struct Step {
    int higher, lower;
  };
  std::vector<Step> steps;
  for (const int c : cells.occupied) {
    const std::size_t at = as_size(c);
    if (ground.z[at] == kNoHeight) continue;
    const int x = c % w, y = c / w;
    for (int dy = 0; dy <= 2 && y + dy < h; ++dy) {
      for (int dx = dy == 0 ? 1 : -2; dx <= 2; ++dx) {
        if (x + dx < 0 || x + dx >= w) continue;
        const int other = c + dy * w + dx;
        const std::size_t o = as_size(other);
        if (ground.z[o] == kNoHeight) continue;
        const Eigen::Vector2f offset(static_cast<float>(dx), static_cast<float>(dy));
        const float step = ground.z[o] - ground.z[at] - 0.5f * (slopes[at] + slopes[o]).dot(offset);
        if (std::abs(step) <= rules.step + rules.step_per_metre * cells.cell * offset.norm()) {
          const int a = root(c), b = root(other);
          if (a == b) continue;
          parent[as_size(a)] += parent[as_size(b)];
          parent[as_size(b)] = a;
        } else {
          steps.push_back(step > 0.0f ? Step{other, c} : Step{c, other});
        }
      }
    }
  }
  std::vector<int> balance(cells.count(), 0);
  struct Extent {
    int low_x, high_x, low_y, high_y;
  };
  std::vector<Extent> extents(cells.count(), Extent{w, -1, h, -1});
  for (const int c : cells.occupied) {
    if (ground.z[as_size(c)] == kNoHeight) continue;
    Extent& extent = extents[as_size(root(c))];
    extent = {std::min(extent.low_x, c % w), std::max(extent.high_x, c % w),
              std::min(extent.low_y, c / w), std::max(extent.high_y, c / w)};
  }
  for (const Step& step : steps) {
    const int above = root(step.higher), below = root(step.lower);
    if (above == below) continue;
    balance[as_size(above)] += 1;
    balance[as_size(below)] -= 2;
  }
  const float area = rules.largest_object * rules.largest_object / (cells.cell * cells.cell);
  const int longest = longest_piece(rules, cells.cell);
  for (const int c : cells.occupied) {
    const std::size_t r = as_size(root(c));
    const Extent& extent = extents[r];
    const bool small = static_cast<float>(-parent[r]) < area &&
                       extent.high_x - extent.low_x <= longest &&
                       extent.high_y - extent.low_y <= longest;
    if (balance[r] > 0 && small) ground.z[as_size(c)] = kNoHeight;
  }
}

/// A plane over a cell: its height in the cell's middle, and slopes, m a cell.
struct CellPlane {
  float z, slope_u, slope_v;
};

/// Of the points' distances from a plane, those within reach.
struct DistanceSums {
  float sum = 0.0f, squares = 0.0f, count = 0.0f;
};

CAMBER_TARGET_CLONES("avx2")
DistanceSums sum_distances(const CellPoint* points, std::size_t count, const CellPlane& plane,
                           float reach) {
  const F8 none = {};
  F8 sum = {}, squares = {}, near = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    PointLanes p;
    load_lanes(points + i, count - i, p);
    F8 r = p.h - (plane.z + plane.slope_u * (p.u - 0.5f) + plane.slope_v * (p.v - 0.5f));
    const I8 used = (r >= -reach) & (r <= reach) & p.there;
    r = used ? r : none;
    sum += r;
    squares += r * r;
    near += used ? none + 1.0f : none;
  }
  return {sum_of_lanes(sum), sum_of_lanes(squares), sum_of_lanes(near)};
}

/// Moves one ground cell to the mean of the points near its plane. @return their scatter, m;
/// negative where they are few
float refine_cell(const GroundCells& cells, const HeightGrid& filled, float reach, int c,
                  HeightGrid& ground) {
  const std::size_t at = as_size(c);
  if (ground.z[at] == kNoHeight) return -1.0f;
  const int x = c % cells.width, y = c / cells.width;
  const Eigen::Vector2f slope = gradient(filled, x, y, 1);
  const CellPlane plane = {ground.z[at], slope.x(), slope.y()};
  const DistanceSums near =
      sum_distances(cells.points.data() + cells.start[at],
                    as_size(cells.start[at + 1] - cells.start[at]), plane, reach);
  if (near.count == 0.0f) return -1.0f;
  const float mean = near.sum / near.count;
  ground.z[at] += mean;
  if (near.count < 5.0f) return -1.0f;
  return std::sqrt(std::max(0.0f, near.squares / near.count - mean * mean));
}

/// Moves all ground cells. @return the lower third over cells of the points' scatter, m; 0 where
/// cells hold few points.
float refine(const GroundCells& cells, const HeightGrid& filled, float reach, int num_threads,
             HeightGrid& ground) {
  std::vector<float> scatter(cells.occupied.size());
  const std::vector<std::size_t> runs = cell_runs(cells);
  parallel_for(runs.size() - 1, num_threads, [&](std::size_t run) {
    for (std::size_t k = runs[run]; k < runs[run + 1]; ++k) {
      scatter[k] = refine_cell(cells, filled, reach, cells.occupied[k], ground);
    }
  });
  scatter.erase(std::remove_if(scatter.begin(), scatter.end(), [](float s) { return s < 0.0f; }),
                scatter.end());
  if (scatter.empty()) return 0.0f;
  const auto third = scatter.begin() + static_cast<std::ptrdiff_t>(scatter.size() / 3);
  std::nth_element(scatter.begin(), third, scatter.end());
  return *third;
}

}  // namespace

TrendSizes trend_sizes(const GroundRules& rules, double cell) {
  return TrendSizes::for_objects(0.5f * rules.largest_object / static_cast<float>(cell));
}

int longest_piece(const GroundRules& rules, double cell) {
  return static_cast<int>(std::min(2.0 * rules.largest_object / cell, 1e6));
}

int grid_margin(const GroundRules& rules, double cell) {
  const double radius = std::min(0.5 * rules.largest_object / cell, 1024.0);
  return std::max(static_cast<int>(std::ceil(radius)), GapFiller::kReach) + 2;
}

int ground_reach(const GroundRules& rules, double cell) {
  constexpr int kLow = 3 * kAround;                                 // drop_low(), in three rounds
  constexpr int kSlopes = 2, kSteps = 2, kLabels = 2, kPlaces = 2;  // of points in cells
  const TrendSizes sizes = trend_sizes(rules, cell);
  const int radius = static_cast<int>(std::ceil(0.5 * rules.largest_object / cell));
  int coarsest = 1;
  while (radius > 4 * coarsest) coarsest *= 2;
  const int objects = 2 * (radius + coarsest) + coarsest;
  return kLow + sizes.reach() + GapFiller::kReach + objects + GapFiller::kReach + kSlopes + kSteps +
         longest_piece(rules, cell) + kSteps + GapFiller::kReach + kSlopes + kLabels + kPlaces;
}

LowestHeights find_lowest(const GroundCells& cells, int num_threads) {
  LowestHeights out;
  out.heights = HeightGrid(cells.width, cells.height, kNoHeight);
  out.support.assign(cells.count(), 0);
  const std::vector<std::size_t> runs = cell_runs(cells);
  parallel_for(runs.size() - 1, num_threads, [&](std::size_t run) {
    for (std::size_t k = runs[run]; k < runs[run + 1]; ++k) {
      const std::size_t c = as_size(cells.occupied[k]);
      const LowestMode mode = lowest_mode(cells, c, -kNoHeight);
      out.heights.z[c] = mode.height;
      out.support[c] = mode.support;
    }
  });
  return out;
}

void drop_low(const GroundCells& cells, const GroundRules& rules, LowestHeights& out) {
  HeightGrid& lowest = out.heights;
  std::vector<int>& support = out.support;
  constexpr int kFew = 30;  // points
  MarginGrid around(lowest);
  std::vector<int> low;
  std::vector<unsigned char> look(cells.count(), 1);  // again where something has changed
  for (int round = 0; round < 3; ++round) {
    low.clear();
    for (const int c : cells.occupied) {
      const std::size_t at = as_size(c);
      if (look[at] == 0) continue;
      look[at] = 0;
      if (support[at] > kFew || lowest.z[at] == kNoHeight) continue;
      const bool is_low = rules.from_air ? is_below_nearly_all(cells, lowest, c)
                                         : is_below_plane(cells, out, around, c);
      if (is_low) low.push_back(c);
    }
    if (low.empty()) break;
    for (const int c : low) {
      const std::size_t at = as_size(c);
      const LowestMode next = lowest_mode(cells, at, lowest.z[at] + 0.25f);
      lowest.z[at] = next.height;
      support[at] = next.support;
      const int cx = c % cells.width, cy = c / cells.width;
      around.set(cx, cy, next.height);
      for (int y = std::max(cy - kAround, 0); y <= std::min(cy + kAround, cells.height - 1); ++y) {
        for (int x = std::max(cx - kAround, 0); x <= std::min(cx + kAround, cells.width - 1); ++x) {
          look[lowest.at(x, y)] = 1;
        }
      }
    }
  }
}

GroundSurface fit_ground_surface(const GroundCells& cells, const GroundRules& rules,
                                 const HeightGrid& lowest, int num_threads) {
  GroundSurface out;
  HeightGrid& ground = out.heights;
  GapFiller filler;
  const HeightGrid trend =
      ground_trend(lowest, cells.cell, trend_sizes(rules, cells.cell), num_threads);
  HeightGrid filled = lowest;
  filler.fill(trend, filled);
  const std::vector<unsigned char> object = find_objects(cells, rules, lowest, filled);
  ground = HeightGrid(cells.width, cells.height, kNoHeight);
  for (const int c : cells.occupied) {
    if (object[as_size(c)] == 0) ground.z[as_size(c)] = lowest.z[as_size(c)];
  }
  filled = ground;
  filler.fill(trend, filled);
  refine(cells, filled, rules.refine, num_threads, ground);
  remove_raised(cells, rules, filled, ground);
  filled = ground;
  filler.fill(trend, filled);
  out.noise = refine(cells, filled, rules.from_air ? rules.refine : 0.2f, num_threads, ground);
  for (std::size_t c = 0; c < cells.count(); ++c) {
    if (ground.z[c] == kNoHeight) ground.z[c] = filled.z[c];
  }
  return out;
}

}  // namespace camber::detail
