#include "camber/road/segment_ground.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts. Both only
// compare and copy, so that their results are the same.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_CLONES __attribute__((target_clones("arch=haswell", "default")))
#else
#define CAMBER_CLONES
#endif

namespace camber {
namespace {

constexpr float kNone = std::numeric_limits<float>::infinity();  // height of an empty cell

std::size_t as_size(int i) { return static_cast<std::size_t>(i); }

/// A grid of heights over the plan, rows of `width`.
struct Grid {
  int width = 0, height = 0;
  std::vector<float> z;

  Grid() = default;
  Grid(int w, int h, float value) : width(w), height(h), z(as_size(w) * as_size(h), value) {}
  std::size_t at(int x, int y) const { return as_size(y) * as_size(width) + as_size(x); }
  float* row(int y) { return z.data() + at(0, y); }
  const float* row(int y) const { return z.data() + at(0, y); }
};

CAMBER_CLONES void minimum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] < b[i] ? a[i] : b[i];
}
CAMBER_CLONES void maximum(const float* a, const float* b, float* out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) out[i] = a[i] > b[i] ? a[i] : b[i];
}

/// Combines squares of 2 * radius + 1 cells by `combine` (minimum or maximum), the border repeated
/// outwards. Windows are doubled until they are long enough.
void slide(const Grid& in, int radius,
           void (*combine)(const float*, const float*, float*, std::size_t), Grid& out,
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

/// Fills the cells that hold kNone from those around them: means of ever larger squares, smoothed
/// between the known cells. Keeps its memory from one call to the next.
class GapFiller {
 public:
  void fill(Grid& grid, int smoothing) {
    // Coarser and coarser means, until nothing is missing.
    std::size_t levels = 0;
    for (const Grid* fine = &grid;; fine = &coarse_[levels++]) {
      bool gaps = false;
      for (const float z : fine->z) gaps |= z == kNone;
      if (!gaps || (fine->width == 1 && fine->height == 1)) break;
      if (coarse_.size() == levels) coarse_.emplace_back();
      // emplace_back may have moved the level that `fine` points to.
      if (levels > 0) fine = &coarse_[levels - 1];
      shrink(*fine, coarse_[levels]);
    }
    for (std::size_t level = levels; level-- > 0;) {
      Grid& fine = level == 0 ? grid : coarse_[level - 1];
      take_from(coarse_[level], fine);
      float* const z = fine.z.data();
      const int w = fine.width;
      for (int k = 0; k < smoothing; ++k) {
        for (const int i : holes_) z[i] = 0.25f * (z[i - 1] + z[i + 1] + z[i - w] + z[i + w]);
      }
    }
  }

 private:
  static void shrink(const Grid& fine, Grid& coarse) {
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
          if (z == kNone) return;
          sum += z;
          count += 1.0f;
        };
        add(first[2 * x]);
        if (two_rows) add(second[2 * x]);
        if (2 * x + 1 < fine.width) {
          add(first[2 * x + 1]);
          if (two_rows) add(second[2 * x + 1]);
        }
        coarse.z[coarse.at(x, y)] = count > 0.0f ? sum / count : kNone;
      }
    }
  }

  /// Fills the fine gaps by bilinear interpolation of the coarse cells; lists those inside.
  void take_from(const Grid& coarse, Grid& fine) {
    holes_.clear();
    for (int y = 0; y < fine.height; ++y) {
      const float* const near = coarse.row(y / 2);
      const float* const far =
          coarse.row(std::clamp(y / 2 + (y % 2 == 0 ? -1 : 1), 0, coarse.height - 1));
      float* const row = fine.row(y);
      const bool inside = y > 0 && y + 1 < fine.height;
      for (int x = 0; x < fine.width; ++x) {
        if (row[x] != kNone) continue;
        const int x0 = x / 2, x1 = std::clamp(x0 + (x % 2 == 0 ? -1 : 1), 0, coarse.width - 1);
        row[x] = 0.5625f * near[x0] + 0.1875f * (near[x1] + far[x0]) + 0.0625f * far[x1];
        if (inside && x > 0 && x + 1 < fine.width) holes_.push_back(y * fine.width + x);
      }
    }
  }

  std::vector<Grid> coarse_;
  std::vector<int> holes_;
};

struct GridPoint {
  float u, v;  // in cells from the grid's corner
  float h;     // m, along up
  int index;   // into the cloud
};

/// The points in an up-aligned frame, sorted by cell.
struct Cells {
  float cell = 1.0f;  // m
  int width = 0, height = 0;
  std::vector<int> start;  // of each cell in `points`; one more than cells
  std::vector<GridPoint> points;
  std::vector<int> occupied;  // cells with points (or a given height), ascending

  std::size_t count() const { return as_size(width) * as_size(height); }
};

/// What differs between scans from a vehicle and from the air, whose cells hold few points.
struct Rules {
  bool from_air = false;
  float largest_object = 12.0f, slope = 0.2f;
  float step = 0.10f, step_per_metre = 0.08f;  // between neighbouring cells of one piece
  float refine = 0.3f;                         // m, points taken into the surface
};

/// Finds the lowest height above `floor` in a cell that enough points share.
struct LowestMode {
  float height = kNone;  // m, mean of those points
  int support = 0;       // their number
};

LowestMode lowest_mode(const Cells& cells, std::size_t cell, float floor) {
  constexpr float kBin = 0.125f;  // m; two make a window
  constexpr int kBins = 96;
  constexpr float kShare = 0.15f;  // of the fullest window's points
  const auto begin = cells.points.begin() + cells.start[cell],
             end = cells.points.begin() + cells.start[cell + 1];
  float lowest = kNone;
  for (auto p = begin; p != end; ++p) {
    if (p->h > floor) lowest = std::min(lowest, p->h);
  }
  if (lowest == kNone) return {};
  std::uint32_t bins[kBins + 1] = {};
  for (auto p = begin; p != end; ++p) {
    if (p->h > floor)
      ++bins[std::min(static_cast<int>(std::min((p->h - lowest) / kBin, 1e4f)), kBins)];
  }
  std::uint32_t most = 0;
  for (int k = 0; k + 1 < kBins; ++k) most = std::max(most, bins[k] + bins[k + 1]);
  const float enough = std::max(1.0f, kShare * static_cast<float>(most));
  for (int k = 0; k + 1 < kBins; ++k) {
    if (static_cast<float>(bins[k] + bins[k + 1]) < enough) continue;
    const float from = lowest + static_cast<float>(k) * kBin, to = from + 2.0f * kBin;
    float sum = 0.0f;
    int inside = 0;
    for (auto p = begin; p != end; ++p) {
      if (p->h < from || p->h > to) continue;
      sum += p->h;
      ++inside;
    }
    if (inside > 0) return {sum / static_cast<float>(inside), inside};
  }
  return {lowest, 1};
}

/// Drops reflections below the ground, round by round: few points below the plane through the cells
/// around them, or, from the air, below nearly all of these.
void drop_low(const Cells& cells, const Rules& rules, Grid& lowest, std::vector<int>& support) {
  constexpr int kAround = 3;          // cells
  constexpr int kFew = 30;            // points
  constexpr float kBelow = 0.3f;      // m, below the plane
  constexpr float kPerMetre = 0.15f;  // m, for each metre from the middle of the cells around
  constexpr float kAsDeep = 0.2f, kShare = 0.2f;  // m; of the cells around
  std::vector<int> low;
  std::vector<unsigned char> look(cells.count(), 1);  // again where something has changed
  for (int round = 0; round < 3; ++round) {
    low.clear();
    for (const int c : cells.occupied) {
      const std::size_t at = as_size(c);
      if (look[at] == 0) continue;
      look[at] = 0;
      if (support[at] > kFew || lowest.z[at] == kNone) continue;
      const int cx = c % cells.width, cy = c / cells.width;
      const float z = lowest.z[at];
      float s = 0, sx = 0, sy = 0, sz = 0, sxx = 0, sxy = 0, syy = 0, sxz = 0, syz = 0;
      int around = 0, as_low = 0;
      for (int y = std::max(cy - kAround, 0); y <= std::min(cy + kAround, cells.height - 1); ++y) {
        for (int x = std::max(cx - kAround, 0); x <= std::min(cx + kAround, cells.width - 1); ++x) {
          const std::size_t other = lowest.at(x, y);
          if (other == at || lowest.z[other] == kNone) continue;
          const float dx = static_cast<float>(x - cx), dy = static_cast<float>(y - cy),
                      dz = lowest.z[other] - z;
          ++around;
          if (dz < 1.0f + 0.6f * cells.cell * std::max(std::abs(dx), std::abs(dy))) ++as_low;
          const float weight = static_cast<float>(std::min(support[other], kFew));
          s += weight;
          sx += weight * dx;
          sy += weight * dy;
          sz += weight * dz;
          sxx += weight * dx * dx;
          sxy += weight * dx * dy;
          syy += weight * dy * dy;
          sxz += weight * dx * dz;
          syz += weight * dy * dz;
        }
      }
      if (around < 4) continue;
      if (rules.from_air) {
        if (as_low <= 4) low.push_back(c);
        continue;
      }
      if (s < 4.0f * static_cast<float>(support[at])) continue;
      const float mx = sx / s, my = sy / s, mz = sz / s;
      constexpr float kLevel = 0.2f;  // cells^2: held level where those around are in one line
      const float vxx = sxx / s - mx * mx + kLevel, vxy = sxy / s - mx * my,
                  vyy = syy / s - my * my + kLevel, vxz = sxz / s - mx * mz,
                  vyz = syz / s - my * mz;
      const float determinant = vxx * vyy - vxy * vxy;
      const float gx = (vxz * vyy - vyz * vxy) / determinant,
                  gy = (vyz * vxx - vxz * vxy) / determinant;
      const float distance = cells.cell * std::sqrt(mx * mx + my * my);
      if (!(mz - gx * mx - gy * my > kBelow + kPerMetre * distance)) continue;
      // Ground between dense traffic is below that plane too, but is as low in more places.
      int as_deep = 0;
      for (int y = std::max(cy - kAround, 0); y <= std::min(cy + kAround, cells.height - 1); ++y) {
        for (int x = std::max(cx - kAround, 0); x <= std::min(cx + kAround, cells.width - 1); ++x) {
          const std::size_t other = lowest.at(x, y);
          if (other != at && lowest.z[other] < z + kAsDeep) ++as_deep;
        }
      }
      if (static_cast<float>(as_deep) <= kShare * static_cast<float>(around)) low.push_back(c);
    }
    if (low.empty()) break;
    for (const int c : low) {
      const std::size_t at = as_size(c);
      const LowestMode next = lowest_mode(cells, at, lowest.z[at] + 0.25f);
      lowest.z[at] = next.height;
      support[at] = next.support;
      const int cx = c % cells.width, cy = c / cells.width;
      for (int y = std::max(cy - kAround, 0); y <= std::min(cy + kAround, cells.height - 1); ++y) {
        for (int x = std::max(cx - kAround, 0); x <= std::min(cx + kAround, cells.width - 1); ++x) {
          look[lowest.at(x, y)] = 1;
        }
      }
    }
  }
}

/// Marks the cells that rise out of openings of the surface with growing squares. Large squares are
/// taken on a coarser grid.
std::vector<unsigned char> find_objects(const Cells& cells, const Rules& rules, const Grid& lowest,
                                        GapFiller& filler) {
  std::vector<unsigned char> object(cells.count(), 0);
  Grid surface = lowest, eroded, opened;
  filler.fill(surface, 2);
  std::vector<float> space;
  const float reach = std::min(0.5f * rules.largest_object / cells.cell,  // cells
                               static_cast<float>(std::max(cells.width, cells.height)));
  int factor = 1;
  float last = 0.0f;
  for (float radius = 1.0f;; radius = std::max(radius + 1.0f, 1.4f * radius)) {
    const float r = std::min(radius, reach);
    if (r <= last) break;
    while (r / static_cast<float>(factor) > 4.0f) {
      Grid half((surface.width + 1) / 2, (surface.height + 1) / 2, kNone);
      for (int y = 0; y < surface.height; ++y) {
        for (int x = 0; x < surface.width; ++x) {
          float& z = half.z[half.at(x / 2, y / 2)];
          z = std::min(z, surface.z[surface.at(x, y)]);
        }
      }
      surface = std::move(half);
      factor *= 2;
    }
    const int window = std::max(1, static_cast<int>(std::lround(r / static_cast<float>(factor))));
    slide(surface, window, minimum, eroded, space);
    slide(eroded, window, maximum, opened, space);
    const int slack = factor > 1 ? factor : 0;  // a coarse cell has the height of its lowest place
    const float limit = rules.slope * static_cast<float>(window * factor + slack) * cells.cell;
    for (const int c : cells.occupied) {
      const std::size_t at = as_size(c);
      if (lowest.z[at] == kNone) continue;
      const int x = c % cells.width / factor, y = c / cells.width / factor;
      if (lowest.z[at] - opened.z[opened.at(x, y)] > limit) object[at] = 1;
    }
    std::swap(surface, opened);
    last = r;
  }
  return object;
}

/// Slope of a surface over `reach` cells to both sides, m a cell.
Eigen::Vector2f gradient(const Grid& surface, int x, int y, int reach) {
  const int xl = std::max(x - reach, 0), xr = std::min(x + reach, surface.width - 1);
  const int yl = std::max(y - reach, 0), yr = std::min(y + reach, surface.height - 1);
  Eigen::Vector2f out(0.0f, 0.0f);
  if (xr > xl) {
    out.x() =
        (surface.z[surface.at(xr, y)] - surface.z[surface.at(xl, y)]) / static_cast<float>(xr - xl);
  }
  if (yr > yl) {
    out.y() =
        (surface.z[surface.at(x, yr)] - surface.z[surface.at(x, yl)]) / static_cast<float>(yr - yl);
  }
  return out;
}

/// Takes out pieces of the surface that stand above what is around them on most of their border:
/// neighbouring cells whose heights agree, but for the slope of the ground, make a piece; pieces
/// smaller in area than the square of the largest object are judged.
void remove_raised(const Cells& cells, const Rules& rules, const Grid& filled, Grid& ground) {
  const int w = cells.width, h = cells.height;
  std::vector<Eigen::Vector2f> slopes(cells.count(), Eigen::Vector2f::Zero());
  const float steepest = 0.7f * cells.cell;
  for (const int c : cells.occupied) {
    if (ground.z[as_size(c)] == kNone) continue;
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
    if (ground.z[at] == kNone) continue;
    const int x = c % w, y = c / w;
    for (int dy = 0; dy <= 2 && y + dy < h; ++dy) {
      for (int dx = dy == 0 ? 1 : -2; dx <= 2; ++dx) {
        if (x + dx < 0 || x + dx >= w) continue;
        const int other = c + dy * w + dx;
        const std::size_t o = as_size(other);
        if (ground.z[o] == kNone) continue;
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
  for (const Step& step : steps) {
    const int above = root(step.higher), below = root(step.lower);
    if (above == below) continue;
    balance[as_size(above)] += 1;
    balance[as_size(below)] -= 2;
  }
  const float area = rules.largest_object * rules.largest_object / (cells.cell * cells.cell);
  for (const int c : cells.occupied) {
    const std::size_t r = as_size(root(c));
    if (balance[r] > 0 && static_cast<float>(-parent[r]) < area) ground.z[as_size(c)] = kNone;
  }
}

/// Moves each ground cell to the mean of the points near its plane. @return the lower third over
/// cells of the points' scatter, m; 0 where cells hold few points.
float refine(const Cells& cells, const Grid& filled, float reach, Grid& ground) {
  std::vector<float> scatter;
  for (const int c : cells.occupied) {
    const std::size_t at = as_size(c);
    const float z = ground.z[at];
    if (z == kNone) continue;
    const int x = c % cells.width, y = c / cells.width;
    const Eigen::Vector2f slope = gradient(filled, x, y, 1);
    const float u = static_cast<float>(x) + 0.5f, v = static_cast<float>(y) + 0.5f;
    float sum = 0.0f, squares = 0.0f, count = 0.0f;
    for (int i = cells.start[at]; i < cells.start[at + 1]; ++i) {
      const GridPoint& p = cells.points[as_size(i)];
      const float r = p.h - (z + slope.x() * (p.u - u) + slope.y() * (p.v - v));
      if (r < -reach || r > reach) continue;
      sum += r;
      squares += r * r;
      count += 1.0f;
    }
    if (count == 0.0f) continue;
    const float mean = sum / count;
    ground.z[at] = z + mean;
    if (count >= 5.0f) scatter.push_back(std::sqrt(std::max(0.0f, squares / count - mean * mean)));
  }
  if (scatter.empty()) return 0.0f;
  const auto third = scatter.begin() + static_cast<std::ptrdiff_t>(scatter.size() / 3);
  std::nth_element(scatter.begin(), third, scatter.end());
  return *third;
}

/// Labels the points by their height above the surface.
class Labeller {
 public:
  Labeller(const Cells& cells, const Grid& ground, bool from_air, float tolerance, float narrow)
      : cells_(cells),
        ground_(ground),
        from_air_(from_air),
        tolerance_(tolerance),
        narrow_(narrow) {}

  void label(int cell, GroundSegmentation& out) {
    const std::size_t at = as_size(cell);
    const int x = cell % cells_.width, y = cell / cells_.width;
    float tolerance = tolerance_;
    if (from_air_) tolerance += 0.7f * gradient(ground_, x, y, 1).norm();
    // Points near the surface, and where points rise from it, by sixteenths of the cell.
    near_.clear();
    int rising[16] = {};
    for (int i = cells_.start[at]; i < cells_.start[at + 1]; ++i) {
      const GridPoint& p = cells_.points[as_size(i)];
      const float above = p.h - surface(p);
      if (!(above > -kDeepest - tolerance && above < tolerance + 0.4f)) continue;
      const int column = std::clamp(static_cast<int>(4.0f * (p.u - static_cast<float>(x))), 0, 3);
      const int row = std::clamp(static_cast<int>(4.0f * (p.v - static_cast<float>(y))), 0, 3);
      if (above >= tolerance) ++rising[4 * row + column];
      if (above < tolerance + kHighest) near_.push_back({above, p.index, row, column});
    }
    float shift[4] = {};
    find_shifts(tolerance, shift);
    for (const Near& p : near_) {
      const float r = p.above - shift[p.quarter()];
      if (!(r > -tolerance && r < tolerance)) continue;
      // The foot of what rises here.
      if (!from_air_ && r > narrow_ && rising[4 * p.row + p.column] >= 2) continue;
      out.labels[as_size(p.index)] = 1;
      ++out.ground;
    }
  }

 private:
  static constexpr float kDeepest = 0.45f, kHighest = 0.12f;  // m, of shifts

  struct Near {
    float above;
    int index, row, column;
    std::size_t quarter() const { return as_size(row / 2 * 2 + column / 2); }
  };

  /// Bilinear between the middles of cells.
  float surface(const GridPoint& p) const {
    const float x = std::clamp(p.u - 0.5f, 0.0f, static_cast<float>(ground_.width - 1)),
                y = std::clamp(p.v - 0.5f, 0.0f, static_cast<float>(ground_.height - 1));
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const int x1 = std::min(x0 + 1, ground_.width - 1), y1 = std::min(y0 + 1, ground_.height - 1);
    const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
    const float* const near = ground_.row(y0);
    const float* const far = ground_.row(y1);
    return (1.0f - fy) * ((1.0f - fx) * near[x0] + fx * near[x1]) +
           fy * ((1.0f - fx) * far[x0] + fx * far[x1]);
  }

  /// What the surface misses between the middles of cells (kerbs, ditches, crests): the mean height
  /// of the lowest points of each quarter, if they are enough.
  void find_shifts(float tolerance, float* shift) const {
    float lowest[4] = {kNone, kNone, kNone, kNone}, sum[4] = {}, low[4] = {}, all[4] = {};
    for (const Near& p : near_) {
      if (p.above <= -kDeepest || p.above >= tolerance) continue;
      const std::size_t q = p.quarter();
      lowest[q] = std::min(lowest[q], p.above);
      all[q] += 1.0f;
    }
    for (const Near& p : near_) {
      const std::size_t q = p.quarter();
      if (p.above <= -kDeepest || p.above >= tolerance) continue;
      if (p.above > lowest[q] + 1.5f * tolerance) continue;
      sum[q] += p.above;
      low[q] += 1.0f;
    }
    for (std::size_t q = 0; q < 4; ++q) {
      if (low[q] >= 3.0f && low[q] >= 0.4f * all[q]) {
        shift[q] = std::clamp(sum[q] / low[q], -kDeepest, kHighest);
      }
    }
  }

  const Cells& cells_;
  const Grid& ground_;
  bool from_air_;
  float tolerance_, narrow_;
  std::vector<Near> near_;
};

/// An up-aligned frame: plan coordinates u, v and the height, m, relative to the cloud's origin.
struct Frame {
  Eigen::Vector3d e1, e2, up;
  Eigen::Matrix3f axes;

  explicit Frame(const Eigen::Vector3d& direction) : up(direction.normalized()) {
    const Eigen::Vector3d along =
        std::abs(up.x()) < 0.7 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
    e1 = (along - up * up.dot(along)).normalized();
    e2 = up.cross(e1);
    axes.row(0) = e1.cast<float>();
    axes.row(1) = e2.cast<float>();
    axes.row(2) = up.cast<float>();
  }
  Eigen::Vector3f operator()(const Eigen::Vector3f& p) const { return axes * p; }
};

bool usable(const Eigen::Vector3f& q) {
  return std::abs(q.x()) + std::abs(q.y()) + std::abs(q.z()) < 1e9f;
}

struct Bounds {
  float low[2] = {kNone, kNone}, high[2] = {-kNone, -kNone};
  double width() const { return static_cast<double>(high[0]) - low[0]; }
  double height() const { return static_cast<double>(high[1]) - low[1]; }
};

/// Bounds of the points with few of them left out, so that a grid of squares of a given size has at
/// most `most` of them; where that is not enough, the size grows.
Bounds choose_bounds(const RoadCloud& cloud, const Frame& frame, const Bounds& all, double most,
                     double* cell) {
  const auto squares = [&](const Bounds& b) {
    return (b.width() / *cell + 1.0) * (b.height() / *cell + 1.0);
  };
  if (squares(all) <= most) return all;
  Bounds bounds = all;
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

Cells sort_by_cell(const RoadCloud& cloud, const Frame& frame, const Bounds& bounds, double size) {
  Cells cells;
  cells.cell = static_cast<float>(size);
  cells.width = static_cast<int>(bounds.width() / size) + 1;
  cells.height = static_cast<int>(bounds.height() / size) + 1;
  cells.start.assign(cells.count() + 1, 0);
  const float inverse = 1.0f / cells.cell;
  const auto place = [&](const Eigen::Vector3f& p, GridPoint* out) {
    const Eigen::Vector3f q = frame(p);
    if (!(usable(q) && q.x() >= bounds.low[0] && q.x() <= bounds.high[0] &&
          q.y() >= bounds.low[1] && q.y() <= bounds.high[1])) {
      return -1;
    }
    out->u = (q.x() - bounds.low[0]) * inverse;
    out->v = (q.y() - bounds.low[1]) * inverse;
    out->h = q.z();
    return std::min(static_cast<int>(out->v), cells.height - 1) * cells.width +
           std::min(static_cast<int>(out->u), cells.width - 1);
  };
  GridPoint point{};
  for (const Eigen::Vector3f& p : cloud.points) {
    const int c = place(p, &point);
    if (c >= 0) ++cells.start[as_size(c) + 1];
  }
  for (std::size_t c = 0; c < cells.count(); ++c) {
    if (cells.start[c + 1] > 0) cells.occupied.push_back(static_cast<int>(c));
    cells.start[c + 1] += cells.start[c];
  }
  cells.points.resize(as_size(cells.start.back()));
  std::vector<int> next(cells.start.begin(), cells.start.end() - 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int c = place(cloud.points[i], &point);
    if (c < 0) continue;
    point.index = static_cast<int>(i);
    cells.points[as_size(next[as_size(c)]++)] = point;
  }
  return cells;
}

/// Median and mean over occupied squares of 2 x 2 cells of the points a square metre, and the share
/// of squares that are occupied.
struct Density {
  double median = 0.0, mean = 0.0, share = 0.0;
};

Density measure_density(const Cells& cells) {
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

}  // namespace

void GroundOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (good) return;
    throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                                expected);
  };
  require(up.allFinite() && up.norm() > 0.0, "up", up.norm(), "a direction");
  require(!std::isinf(sensor_height), "sensor_height", sensor_height, "a number of metres");
  require(std::isfinite(cell) && cell >= 0.0, "cell", cell, "0 m or more");
  require(std::isfinite(largest_object) && largest_object >= 0.0, "largest_object", largest_object,
          "0 m or more");
  require(std::isfinite(slope) && slope >= 0.0, "slope", slope, "0 or more");
  require(std::isfinite(tolerance) && tolerance >= 0.0, "tolerance", tolerance, "0 m or more");
}

GroundSegmentation segment_ground(const RoadCloud& cloud, const GroundOptions& options) {
  options.validate();
  GroundSegmentation out;
  out.labels.assign(cloud.size(), 0);

  const Frame frame(options.up);
  Bounds all;
  std::size_t finite = 0;
  for (const Eigen::Vector3f& p : cloud.points) {
    const Eigen::Vector3f q = frame(p);
    if (!usable(q)) continue;
    ++finite;
    for (int axis = 0; axis < 2; ++axis) {
      all.low[axis] = std::min(all.low[axis], q[axis]);
      all.high[axis] = std::max(all.high[axis], q[axis]);
    }
  }
  if (finite < 3) {
    out.status = Status::kFailed;
    out.reason = "found " + std::to_string(finite) + " finite points, expected at least 3";
    return out;
  }

  const double most = std::max(131072.0, 4.0 * static_cast<double>(finite));
  double cell = options.cell > 0.0 ? options.cell : 1.0;
  Bounds bounds = choose_bounds(cloud, frame, all, most, &cell);
  Cells cells = sort_by_cell(cloud, frame, bounds, cell);
  // Scans from the air see about as many points everywhere, others many near by and none behind
  // things.
  const Density density = measure_density(cells);
  Rules rules;
  const bool sparse = density.median < 4.0;
  const bool even =
      density.median > 0.5 * density.mean && std::min(bounds.width(), bounds.height()) > 60.0;
  rules.from_air = density.share > 0.5 && (sparse || even) && finite > 500;
  if (rules.from_air) {
    rules.largest_object = 30.0f;
    rules.slope = 0.35f;
    rules.step = 0.5f;
    rules.step_per_metre = 0.2f;
    rules.refine = 0.5f;
    if (options.cell == 0.0) {
      cell = std::clamp(1.5 / std::sqrt(density.median), 1.0, 4.0);
      bounds = choose_bounds(cloud, frame, all, most, &cell);
      cells = sort_by_cell(cloud, frame, bounds, cell);
    }
  }
  if (options.largest_object > 0.0) {
    rules.largest_object = static_cast<float>(options.largest_object);
  }
  if (options.slope > 0.0) rules.slope = static_cast<float>(options.slope);
  out.from_air = rules.from_air;
  out.cell = cell;
  out.largest_object = rules.largest_object;
  out.slope = rules.slope;

  Grid lowest(cells.width, cells.height, kNone);
  std::vector<int> support(cells.count(), 0);
  for (const int c : cells.occupied) {
    const LowestMode mode = lowest_mode(cells, as_size(c), -kNone);
    lowest.z[as_size(c)] = mode.height;
    support[as_size(c)] = mode.support;
  }
  if (std::isfinite(options.sensor_height)) {
    // The ground under the sensor, where nothing, or only the vehicle that carries it, is seen.
    const Eigen::Vector3d sensor = -cloud.origin;
    const double u = (frame.e1.dot(sensor) - bounds.low[0]) / cell,
                 v = (frame.e2.dot(sensor) - bounds.low[1]) / cell;
    const float h = static_cast<float>(frame.up.dot(sensor) - options.sensor_height);
    if (u >= 0.0 && v >= 0.0 && u < cells.width && v < cells.height) {
      const int c = static_cast<int>(v) * cells.width + static_cast<int>(u);
      if (!(std::abs(lowest.z[as_size(c)] - h) < 0.5f)) {
        lowest.z[as_size(c)] = h;
        support[as_size(c)] = 1000;
        const auto place = std::lower_bound(cells.occupied.begin(), cells.occupied.end(), c);
        if (place == cells.occupied.end() || *place != c) cells.occupied.insert(place, c);
      }
    }
  }

  drop_low(cells, rules, lowest, support);
  GapFiller filler;
  const std::vector<unsigned char> object = find_objects(cells, rules, lowest, filler);
  Grid ground(cells.width, cells.height, kNone);
  for (const int c : cells.occupied) {
    if (object[as_size(c)] == 0) ground.z[as_size(c)] = lowest.z[as_size(c)];
  }
  Grid filled = ground;
  filler.fill(filled, 2);
  refine(cells, filled, rules.refine, ground);
  remove_raised(cells, rules, filled, ground);
  filled = ground;
  filler.fill(filled, 2);
  const float noise = refine(cells, filled, rules.from_air ? rules.refine : 0.2f, ground);
  for (std::size_t c = 0; c < cells.count(); ++c) {
    if (ground.z[c] == kNone) ground.z[c] = filled.z[c];
  }

  float tolerance = rules.from_air ? 0.4f : std::clamp(0.08f + 2.5f * noise, 0.08f, 0.4f);
  float narrow = std::min(tolerance, 0.02f + 1.5f * noise);
  if (options.tolerance > 0.0) tolerance = narrow = static_cast<float>(options.tolerance);
  out.tolerance = tolerance;
  Labeller labeller(cells, ground, rules.from_air, tolerance, narrow);
  for (const int c : cells.occupied) labeller.label(c, out);
  if (out.ground == 0) {
    out.status = Status::kFailed;
    out.reason = "no point lies on the ground's surface";
    return out;
  }
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
