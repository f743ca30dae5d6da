#include "camber/road/ground_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <tuple>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

// Largest leaf; halving leaves half of that at least. Smaller ones where points are few.
constexpr std::size_t kLeafPoints = 48, kSmallLeafPoints = 14;
constexpr std::size_t kFewPoints = 40000;
constexpr std::size_t kBlockPoints = 320;  // largest block
constexpr std::size_t kPiece = 262144;     // points of a cloud that are looked at in one go
constexpr double kStray = 10.0;  // points farther from the middle than this many spreads are strays
constexpr std::size_t kCells =
    8192;  // cells to a spread, by which a part of a large cloud is drawn

/// A number that depends on nothing but three others; SplitMix64's finaliser.
std::uint64_t hash_of(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  std::uint64_t z =
      a * 0x9E3779B97F4A7C15ull + b * 0xD1B54A32D192ED03ull + c * 0x8CB92BA72F3D8DD7ull;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

std::uint64_t bits_of(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits;
}

/// Ranks of a leaf's values. @param values  kLeafPoints, whatever their number
/// @return  whether no two are equal
CAMBER_TARGET_CLONES("avx2")
bool rank_values(const float* values, std::size_t count, std::int32_t* rank) {
  for (std::size_t j = 0; j < kLeafPoints; ++j) rank[j] = 0;
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j < kLeafPoints; ++j) rank[j] += values[i] < values[j] ? 1 : 0;
  }
  std::size_t sum = 0;
  for (std::size_t j = 0; j < count; ++j) sum += static_cast<std::size_t>(rank[j]);
  return 2 * sum == count * (count - 1);
}

bool usable(const Eigen::Vector3f& p) {
  return std::abs(p.x()) < 1e15f && std::abs(p.y()) < 1e15f && std::abs(p.z()) < 1e15f;
}

std::size_t number_of_pieces(const RoadCloud& cloud) {
  return (cloud.size() + kPiece - 1) / kPiece;
}

/// About one in so many points, drawn by their coordinates.
std::vector<Eigen::Vector3f> draw_points(const RoadCloud& cloud, std::uint64_t every,
                                         int num_threads) {
  const std::size_t n = cloud.size();
  std::vector<std::vector<Eigen::Vector3f>> lists(number_of_pieces(cloud));
  parallel_for(lists.size(), num_threads, [&](std::size_t piece) {
    for (std::size_t i = piece * kPiece; i < std::min(n, (piece + 1) * kPiece); ++i) {
      const Eigen::Vector3f& p = cloud.points[i];
      if (every > 1 && hash_of(bits_of(p.x()), bits_of(p.y()), bits_of(p.z())) % every != 0) {
        continue;
      }
      if (usable(p)) lists[piece].push_back(p);
    }
  });
  std::vector<Eigen::Vector3f> drawn;
  for (const auto& list : lists) drawn.insert(drawn.end(), list.begin(), list.end());
  return drawn;
}

/// A rough middle and size of a cloud: medians, and the distance within which 90 % lie.
struct RoughExtent {
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  double spread = 0.0;
};

/// None where no point is usable.
std::optional<RoughExtent> rough_extent(const RoadCloud& cloud, int num_threads) {
  constexpr std::size_t kFew = 4096, kWanted = 2048, kEnough = 256;  // points
  const std::size_t n = cloud.size();
  const std::uint64_t share = n <= kFew ? 1 : n / kWanted;
  std::vector<Eigen::Vector3f> drawn = draw_points(cloud, share, num_threads);
  if (drawn.size() < kEnough && share > 1) drawn = draw_points(cloud, 1, num_threads);
  if (drawn.empty()) return std::nullopt;
  RoughExtent out;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> values(drawn.size());
    for (std::size_t k = 0; k < drawn.size(); ++k) values[k] = drawn[k][axis];
    out.middle[axis] = static_cast<float>(quantile(values, 0.5));
  }
  std::vector<float> distances(drawn.size());
  for (std::size_t k = 0; k < drawn.size(); ++k) distances[k] = (drawn[k] - out.middle).norm();
  out.spread = quantile(distances, 0.9);
  if (!(out.spread > 0.0)) {
    for (const Eigen::Vector3f& p : cloud.points) {
      if (usable(p))
        out.spread = std::max(out.spread, static_cast<double>((p - out.middle).norm()));
    }
  }
  return out;
}

/// Sums of powers of the coordinates about a place: u and v in plan, w along up.
struct Moments {
  double count = 0, su = 0, sv = 0, sw = 0, uu = 0, uv = 0, vv = 0, ww = 0;
  double uuu = 0, uuv = 0, uvv = 0, vvv = 0;

  void add(const Moments& other) {
    count += other.count;
    su += other.su;
    sv += other.sv;
    sw += other.sw;
    uu += other.uu;
    uv += other.uv;
    vv += other.vv;
    ww += other.ww;
    uuu += other.uuu;
    uuv += other.uuv;
    uvv += other.uvv;
    vvv += other.vvv;
  }

  double mean_u() const { return su / count; }
  double mean_v() const { return sv / count; }
  double mean_w() const { return sw / count; }
  double variance_u() const { return uu / count - mean_u() * mean_u(); }
  double variance_v() const { return vv / count - mean_v() * mean_v(); }
  double variance_w() const { return ww / count - mean_w() * mean_w(); }
  double covariance_uv() const { return uv / count - mean_u() * mean_v(); }

  /// Third moment about the mean along the direction (c, s) in plan.
  double third_along(double c, double s) const {
    const double m = c * mean_u() + s * mean_v();
    return (c * c * c * uuu + 3 * c * c * s * uuv + 3 * c * s * s * uvv + s * s * s * vvv) / count -
           3.0 * m * (c * c * uu + 2.0 * c * s * uv + s * s * vv) / count + 2.0 * m * m * m;
  }
};

/// Of the points that are no strays, about the rough middle.
Moments moments_of(const RoadCloud& cloud, const RoughExtent& rough, const Vector3d& e1,
                   const Vector3d& e2, const Vector3d& up, int num_threads) {
  const std::size_t n = cloud.size();
  const Eigen::Vector3f f1 = e1.cast<float>(), f2 = e2.cast<float>(), f3 = up.cast<float>();
  const float most2 = static_cast<float>(kStray * kStray * rough.spread * rough.spread);
  std::vector<Moments> parts(number_of_pieces(cloud));
  parallel_for(parts.size(), num_threads, [&](std::size_t piece) {
    Moments sums;
    for (std::size_t i = piece * kPiece; i < std::min(n, (piece + 1) * kPiece); ++i) {
      const Eigen::Vector3f q = cloud.points[i] - rough.middle;
      if (!(q.squaredNorm() <= most2)) continue;
      const double u = static_cast<double>(f1.dot(q)), v = static_cast<double>(f2.dot(q)),
                   w = static_cast<double>(f3.dot(q));
      sums.add(
          {1.0, u, v, w, u * u, u * v, v * v, w * w, u * u * u, u * u * v, u * v * v, v * v * v});
    }
    parts[piece] = sums;
  });
  Moments total;
  for (const Moments& part : parts) total.add(part);
  return total;
}

}  // namespace

/// Frame by the cloud itself: origin at the mean, x along the longer principal direction in plan,
/// towards the longer tail. A cloud that was moved, turned about up or put in another order gets
/// the same rows but for rounding.
bool GroundTree::choose_frame(const RoadCloud& cloud, const Vector3d& z, int num_threads) {
  const auto rough = rough_extent(cloud, num_threads);
  if (!rough) return false;
  Vector3d e1, e2;
  UncertainPlane::make_axes(z, std::abs(z.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY(), &e1,
                            &e2);
  const Moments moments = moments_of(cloud, *rough, e1, e2, z, num_threads);
  const double uu = moments.variance_u(), uv = moments.covariance_uv(), vv = moments.variance_v();
  const double angle = 0.5 * std::atan2(2.0 * uv, uu - vv);
  double c = std::cos(angle), s = std::sin(angle);
  if (moments.third_along(c, s) < 0.0) {
    c = -c;
    s = -s;
  }
  const Vector3d x = c * e1 + s * e2;
  frame_.level_from_cloud.row(0) = x;
  frame_.level_from_cloud.row(1) = z.cross(x);
  frame_.level_from_cloud.row(2) = z;
  pivot_ = (rough->middle.cast<double>() + moments.mean_u() * e1 + moments.mean_v() * e2 +
            moments.mean_w() * z)
               .cast<float>();
  frame_.pivot = cloud.origin + pivot_.cast<double>();
  const double mean = 0.5 * (uu + vv), half = std::hypot(0.5 * (uu - vv), uv);
  deviation_ = {static_cast<float>(std::sqrt(std::max(mean + half, 0.0))),
                static_cast<float>(std::sqrt(std::max(mean - half, 0.0)))};
  // Of what is spread evenly over a length, 90 % lie within 1.56 standard deviations.
  spread_ = 1.56 * std::sqrt(std::max(uu + vv + moments.variance_w(), 0.0));
  return true;
}

/// The rows, not yet in order: of a large cloud those in a random part of small cells.
void GroundTree::take_rows(const RoadCloud& cloud, std::uint64_t seed, std::size_t most_points,
                           int num_threads) {
  const std::size_t n = cloud.size(), pieces = number_of_pieces(cloud);
  const Eigen::Matrix3f turn = frame_.level_from_cloud.cast<float>();
  const double share =
      static_cast<double>(most_points) / static_cast<double>(std::max<std::size_t>(n, 1));
  const auto keep =
      share < 1.0 ? static_cast<std::uint64_t>(share * 0x1.0p64) : ~static_cast<std::uint64_t>(0);
  const float per_cell = static_cast<float>(static_cast<double>(kCells) / std::max(spread_, 1e-30));
  const auto cell = [&](float value) {
    return static_cast<std::uint64_t>(
        static_cast<std::int64_t>(std::floor(std::clamp(value * per_cell, -1e15f, 1e15f))));
  };
  std::vector<std::vector<Row>> lists(pieces);
  parallel_for(pieces, num_threads, [&](std::size_t piece) {
    std::vector<Row>& list = lists[piece];
    const std::size_t end = std::min(n, (piece + 1) * kPiece);
    if (!(share < 1.0)) list.reserve(end - piece * kPiece);
    for (std::size_t i = piece * kPiece; i < end; ++i) {
      if (!usable(cloud.points[i])) continue;
      const Eigen::Vector3f p = turn * (cloud.points[i] - pivot_);
      if (share < 1.0 && hash_of(cell(p.x()) + seed, cell(p.y()), cell(p.z())) > keep) continue;
      list.push_back({p.x(), p.y(), p.z(), static_cast<std::uint32_t>(i)});
    }
  });
  if (pieces == 1) {
    rows_ = std::move(lists[0]);
    return;
  }
  for (const std::vector<Row>& list : lists) rows_.insert(rows_.end(), list.begin(), list.end());
}

GroundTree::GroundTree(const RoadCloud& cloud, const Vector3d& up, std::uint64_t seed,
                       std::size_t most_points, int num_threads) {
  if (!choose_frame(cloud, up.normalized(), num_threads)) return;
  take_rows(cloud, seed, most_points, num_threads);
  size_ = rows_.size();
  if (size_ == 0) return;

  leaf_points_ = size_ < kFewPoints ? kSmallLeafPoints : kLeafPoints;
  nodes_.reserve(size_ / 8 + 16);
  sort_into_cells();
  build_from_cells(0, grid_.columns, 0, grid_.lines, false, 0);
  grid_ = Grid();

  // Rows in leaf order, each leaf padded.
  std::size_t total = 0;
  for (Leaf& leaf : leaves_) {
    const std::size_t count = leaf.end - leaf.begin;
    total += kernels::padded(count);
  }
  PointArrays& s = points_;
  s.resize(total, !cloud.sigmas.empty(), !cloud.covariances.empty());
  cloud_index_.assign(total, kPadding);
  std::size_t at = 0;
  for (Leaf& leaf : leaves_) {
    const std::size_t from = leaf.begin, count = leaf.end - leaf.begin;
    leaf.begin = at;
    leaf.end = at + count;
    leaf.padded_end = at + kernels::padded(count);
    for (std::size_t k = 0; k < count; ++k) {
      const Row& row = rows_[from + k];
      s.x[at + k] = row.x;
      s.y[at + k] = row.y;
      s.z[at + k] = row.z;
      s.w[at + k] = 1.0f;
      cloud_index_[at + k] = row.index;
      if (!s.sigma.empty()) s.sigma[at + k] = cloud.sigmas[row.index];
      if (!s.covariance.empty()) {
        const std::array<float, 6>& c = cloud.covariances[row.index];
        Matrix3d full;
        full << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
        const Matrix3d level = frame_.level_from_cloud * full * frame_.level_from_cloud.transpose();
        const auto f = [](double value) { return static_cast<float>(value); };
        s.covariance[at + k] = {f(level(0, 0)), f(level(0, 1)), f(level(0, 2)),
                                f(level(1, 1)), f(level(1, 2)), f(level(2, 2))};
      }
    }
    at = leaf.padded_end;
  }
  rows_.clear();
  rows_.shrink_to_fit();
  find_neighbours(num_threads);
  if (size_ < cloud.size()) find_entries();
}

void GroundTree::find_entries() {
  Entries& e = entries_;
  const Node& root = nodes_[0];
  for (int axis = 0; axis < 2; ++axis) {
    // Strays have the cells at the border.
    const float most = 3.0f * deviation_[axis];
    e.low[axis] = std::max(root.low[axis], -most);
    const float high = std::min(root.high[axis], most);
    e.per_metre[axis] = static_cast<float>(Entries::kSide) / std::max(high - e.low[axis], 1e-20f);
  }
  e.nodes.assign(static_cast<std::size_t>(Entries::kSide) * Entries::kSide, 0);
  enter(0, 0, Entries::kSide, 0, Entries::kSide);
}

/// Notes a node in the cells [x0, x1) x [y0, y1), all in its part of the plan, or what is below it.
void GroundTree::enter(int id, int x0, int x1, int y0, int y1) {
  if (x0 >= x1 || y0 >= y1) return;
  const Node& node = nodes_[static_cast<std::size_t>(id)];
  const auto note = [&](int from_x, int to_x, int from_y, int to_y) {
    for (int y = from_y; y < to_y; ++y) {
      std::fill_n(entries_.nodes.begin() + y * Entries::kSide + from_x, to_x - from_x, id);
    }
  };
  if (node.leaf >= 0) return note(x0, x1, y0, y1);
  // Cells before that of the split are below it, those behind above; in its own there are both.
  if (node.axis == 0) {
    const int cut = std::clamp(entries_.cell(0, node.split), x0, x1 - 1);
    enter(node.below, x0, cut, y0, y1);
    note(cut, cut + 1, y0, y1);
    enter(node.above, cut + 1, x1, y0, y1);
  } else {
    const int cut = std::clamp(entries_.cell(1, node.split), y0, y1 - 1);
    enter(node.below, x0, x1, y0, cut);
    note(x0, x1, cut, cut + 1);
    enter(node.above, x0, x1, cut + 1, y1);
  }
}

/// Counts the rows in a grid of small cells, of which the upper nodes of the tree are made: they
/// need the cells' sums alone.
void GroundTree::sort_into_cells() {
  constexpr float kPerCell = 4.0f;
  Grid& g = grid_;
  Eigen::Array2f high = Eigen::Array2f::Zero();
  g.low = Eigen::Array2f::Zero();
  const Eigen::Array2f most = 3.0f * deviation_;
  for (const Row& row : rows_) {
    if (std::abs(row.x) <= most[0]) {
      g.low[0] = std::min(g.low[0], row.x);
      high[0] = std::max(high[0], row.x);
    }
    if (std::abs(row.y) <= most[1]) {
      g.low[1] = std::min(g.low[1], row.y);
      high[1] = std::max(high[1], row.y);
    }
  }
  const Eigen::Array2f extent = (high - g.low).max(1e-20f);
  const float number = std::max(1.0f, static_cast<float>(size_) / kPerCell);
  const auto along = [&](float share) {
    return static_cast<int>(std::clamp(std::sqrt(number * share), 1.0f, 4096.0f));
  };
  g.columns = along(extent[0] / extent[1]);
  g.lines = along(extent[1] / extent[0]);
  g.size = extent / Eigen::Array2f(static_cast<float>(g.columns), static_cast<float>(g.lines));
  const Eigen::Array2f per_cell = 1.0f / g.size;
  const auto columns = static_cast<std::size_t>(g.columns),
             lines = static_cast<std::size_t>(g.lines);
  g.start.assign(columns * lines + 1, 0);
  std::vector<std::uint32_t> cell_of(size_);
  const float last_column = static_cast<float>(g.columns - 1),
              last_line = static_cast<float>(g.lines - 1);
  for (std::size_t k = 0; k < size_; ++k) {
    const float x = std::clamp((rows_[k].x - g.low[0]) * per_cell[0], 0.0f, last_column),
                y = std::clamp((rows_[k].y - g.low[1]) * per_cell[1], 0.0f, last_line);
    cell_of[k] = static_cast<std::uint32_t>(y) * static_cast<std::uint32_t>(g.columns) +
                 static_cast<std::uint32_t>(x);
    ++g.start[cell_of[k] + 1];
  }
  for (std::size_t c = 0; c < columns * lines; ++c) g.start[c + 1] += g.start[c];
  // Sums of the cells below and left of each corner of the grid.
  g.sum.assign((columns + 1) * (lines + 1), 0);
  for (std::size_t y = 0; y < lines; ++y) {
    std::uint32_t line = 0;
    for (std::size_t x = 0; x < columns; ++x) {
      const std::size_t c = y * columns + x;
      line += g.start[c + 1] - g.start[c];
      g.sum[(y + 1) * (columns + 1) + x + 1] = g.sum[y * (columns + 1) + x + 1] + line;
    }
  }
  g.rows.resize(size_);
  std::vector<std::uint32_t> next(g.start.begin(), g.start.end() - 1);
  for (std::size_t k = 0; k < size_; ++k) g.rows[next[cell_of[k]]++] = rows_[k];
  rows_.clear();
}

/// Node of the cells [x0, x1) x [y0, y1).
int GroundTree::build_from_cells(int x0, int x1, int y0, int y1, bool in_block,
                                 std::uint64_t name) {
  const Grid& g = grid_;
  const auto corner = [&](int x, int y) {
    return g.sum[static_cast<std::size_t>(y) * static_cast<std::size_t>(g.columns + 1) +
                 static_cast<std::size_t>(x)];
  };
  const auto number = [&](int ax, int bx, int ay, int by) {
    return corner(bx, by) - corner(ax, by) - corner(bx, ay) + corner(ax, ay);
  };
  const std::size_t n = number(x0, x1, y0, y1);
  const auto take = [&] {
    const std::size_t begin = rows_.size();
    for (int y = y0; y < y1; ++y) {
      const auto line = static_cast<std::size_t>(y) * static_cast<std::size_t>(g.columns);
      rows_.insert(rows_.end(), g.rows.begin() + g.start[line + static_cast<std::size_t>(x0)],
                   g.rows.begin() + g.start[line + static_cast<std::size_t>(x1)]);
    }
    return begin;
  };
  int axis = 0, cut = 0;
  if (n > leaf_points_) {
    // Of each axis: how far all but 4 % on either side reach, and the edge that halves best.
    float extent[2];
    int half[2];
    bool balanced[2];
    for (int a = 0; a < 2; ++a) {
      const int from = a == 0 ? x0 : y0, to = a == 0 ? x1 : y1;
      int first = from, last = to;
      std::size_t nearest = n + 1, below = 0;
      half[a] = from;
      for (int edge = from; edge <= to; ++edge) {
        const std::size_t sum = a == 0 ? number(x0, edge, y0, y1) : number(x0, x1, y0, edge);
        if (25 * sum <= n) first = edge;
        if (25 * (n - sum) >= n) last = std::min(edge + 1, to);
        const std::size_t off = sum > n - sum ? 2 * sum - n : n - 2 * sum;
        if (off < nearest) {
          nearest = off;
          half[a] = edge;
          below = sum;
        }
      }
      extent[a] = static_cast<float>(last - first) * g.size[a];
      balanced[a] = 4 * below >= n && 4 * (n - below) >= n;
    }
    axis = extent[0] >= extent[1] ? 0 : 1;
    // Too much in one line of cells: by the points themselves.
    if (!balanced[axis]) {
      const std::size_t begin = take();
      const Eigen::Array2f low =
          g.low + Eigen::Array2f(static_cast<float>(x0), static_cast<float>(y0)) * g.size;
      const Eigen::Array2f high =
          g.low + Eigen::Array2f(static_cast<float>(x1), static_cast<float>(y1)) * g.size;
      return build(begin, rows_.size(), in_block, low, high, name);
    }
    cut = half[axis];
  }
  const int id = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  const bool new_block = !in_block && n <= kBlockPoints;
  if (new_block) blocks_.push_back({leaves_.size(), leaves_.size(), name});
  if (n <= leaf_points_) {
    const std::size_t begin = take();
    finish_leaf(id, begin, rows_.size(), name);
  } else {
    const bool inside = in_block || new_block;
    const std::uint64_t low_name = hash_of(name, 1, 0), high_name = hash_of(name, 2, 0);
    const int below = axis == 0 ? build_from_cells(x0, cut, y0, y1, inside, low_name)
                                : build_from_cells(x0, x1, y0, cut, inside, low_name);
    const int above = axis == 0 ? build_from_cells(cut, x1, y0, y1, inside, high_name)
                                : build_from_cells(x0, x1, cut, y1, inside, high_name);
    join(id, axis, g.low[axis] + static_cast<float>(cut) * g.size[axis], below, above);
  }
  if (new_block) blocks_.back().last = leaves_.size();
  return id;
}

void GroundTree::join(int id, int axis, float split, int below, int above) {
  Node& node = nodes_[static_cast<std::size_t>(id)];
  const Node &b = nodes_[static_cast<std::size_t>(below)],
             &a = nodes_[static_cast<std::size_t>(above)];
  node.axis = axis;
  node.split = split;
  node.below = below;
  node.above = above;
  node.low = b.low.min(a.low);
  node.high = b.high.max(a.high);
}

/// @param low, high  of the part of the plan that the rows are in; strays may lie outside it
int GroundTree::build(std::size_t begin, std::size_t end, bool in_block, Eigen::Array2f low,
                      Eigen::Array2f high, std::uint64_t name) {
  const int id = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  const bool new_block = !in_block && end - begin <= kBlockPoints;
  if (new_block) blocks_.push_back({leaves_.size(), leaves_.size(), name});
  if (end - begin <= leaf_points_) {
    finish_leaf(id, begin, end, name);
  } else {
    // Histograms do not depend on the order of the rows.
    constexpr int kBins = 64;
    std::array<std::uint32_t, kBins + 2> bins[2] = {};
    const Eigen::Array2f width = (high - low).max(1e-30f) / static_cast<float>(kBins);
    const Eigen::Array2f per_bin = 1.0f / width;
    for (std::size_t k = begin; k < end; ++k) {
      const float px = (rows_[k].x - low[0]) * per_bin[0] + 1.0f,
                  py = (rows_[k].y - low[1]) * per_bin[1] + 1.0f;
      ++bins[0][static_cast<std::size_t>(std::min(std::max(px, 0.0f), kBins + 1.0f))];
      ++bins[1][static_cast<std::size_t>(std::min(std::max(py, 0.0f), kBins + 1.0f))];
    }
    const std::size_t n = end - begin;
    // Of each axis: where all but 4 % on either side lie, and the edge that halves best.
    int first[2], last[2], half[2];
    std::size_t below_half[2];
    for (int axis = 0; axis < 2; ++axis) {
      std::size_t sum = 0, nearest = n;
      first[axis] = kBins;
      last[axis] = 0;
      half[axis] = 0;
      below_half[axis] = 0;
      for (int k = 0; k <= kBins; ++k) {
        if (25 * sum <= n) first[axis] = std::max(k - 1, 0);
        sum += bins[axis][static_cast<std::size_t>(k)];
        // `sum` rows lie below low + k * width.
        const std::size_t off = sum > n - sum ? 2 * sum - n : n - 2 * sum;
        if (off < nearest) {
          nearest = off;
          half[axis] = k;
          below_half[axis] = sum;
        }
        if (25 * (n - sum) >= n) last[axis] = std::min(k + 1, kBins);
      }
    }
    const float extent[2] = {static_cast<float>(last[0] - first[0]) * width[0],
                             static_cast<float>(last[1] - first[1]) * width[1]};
    const int axis = extent[0] >= extent[1] ? 0 : 1;
    float middle = low[axis] + static_cast<float>(half[axis]) * width[axis];
    std::size_t cut = begin;
    if (8 * below_half[axis] >= n && 8 * (n - below_half[axis]) >= n) {
      if (axis == 0) {
        for (std::size_t k = begin; k < end; ++k) {
          const Row row = rows_[k];
          rows_[k] = rows_[cut];
          rows_[cut] = row;
          cut += row.x < middle ? 1 : 0;
        }
      } else {
        for (std::size_t k = begin; k < end; ++k) {
          const Row row = rows_[k];
          rows_[k] = rows_[cut];
          rows_[cut] = row;
          cut += row.y < middle ? 1 : 0;
        }
      }
    }
    // Many in one bin: halve exactly.
    if (8 * (cut - begin) < n || 8 * (end - cut) < n) {
      cut = begin + n / 2;
      const auto less = [axis](const Row& l, const Row& r) {
        return axis == 0 ? std::tie(l.x, l.y, l.z) < std::tie(r.x, r.y, r.z)
                         : std::tie(l.y, l.x, l.z) < std::tie(r.y, r.x, r.z);
      };
      std::nth_element(rows_.begin() + static_cast<long>(begin),
                       rows_.begin() + static_cast<long>(cut),
                       rows_.begin() + static_cast<long>(end), less);
      middle = axis == 0 ? rows_[cut].x : rows_[cut].y;
    }
    // The children's part: without the empty margins, so that their bins are finer.
    for (int k = 0; k < 2; ++k) {
      const float from = low[k], step = width[k];
      low[k] = from + static_cast<float>(std::max(first[k] - 1, 0)) * step;
      high[k] = from + static_cast<float>(std::min(last[k] + 1, kBins)) * step;
    }
    Eigen::Array2f high_below = high, low_above = low;
    high_below[axis] = low_above[axis] = middle;
    const int below =
        build(begin, cut, in_block || new_block, low, high_below, hash_of(name, 1, 0));
    const int above = build(cut, end, in_block || new_block, low_above, high, hash_of(name, 2, 0));
    join(id, axis, middle, below, above);
  }
  if (new_block) blocks_.back().last = leaves_.size();
  return id;
}

/// Rows by x, equal ones by y, then z. Few rows find their places by how many come before them.
void GroundTree::sort_along_x(Row* rows, std::size_t count) {
  if (count <= kLeafPoints) {
    float x[kLeafPoints] = {};
    std::int32_t rank[kLeafPoints];
    Row sorted[kLeafPoints];
    for (std::size_t k = 0; k < count; ++k) x[k] = rows[k].x;
    if (rank_values(x, count, rank)) {
      for (std::size_t k = 0; k < count; ++k) sorted[rank[k]] = rows[k];
      std::copy_n(sorted, count, rows);
      return;
    }
  }
  std::sort(rows, rows + count, [](const Row& l, const Row& r) {
    return l.x != r.x ? l.x < r.x : std::tie(l.y, l.z) < std::tie(r.y, r.z);
  });
}

void GroundTree::finish_leaf(int id, std::size_t begin, std::size_t end, std::uint64_t name) {
  sort_along_x(rows_.data() + begin, end - begin);
  Leaf leaf;
  leaf.name = name;
  leaf.begin = begin;
  leaf.end = end;
  // Box without the outermost point on each side, if there are enough.
  const std::size_t count = end - begin, skip = count >= 12 ? 1 : 0;
  leaf.low[0] = rows_[begin + skip].x;
  leaf.high[0] = rows_[end - 1 - skip].x;
  float least[2], most[2];
  least[0] = least[1] = std::numeric_limits<float>::infinity();
  most[0] = most[1] = -least[0];
  for (std::size_t k = begin; k < end; ++k) {
    const float y = rows_[k].y;
    least[1] = std::min(least[1], std::max(least[0], y));
    least[0] = std::min(least[0], y);
    most[1] = std::max(most[1], std::min(most[0], y));
    most[0] = std::max(most[0], y);
  }
  leaf.low[1] = least[skip];
  leaf.high[1] = most[skip];
  Node& node = nodes_[static_cast<std::size_t>(id)];
  node.leaf = static_cast<int>(leaves_.size());
  node.low = leaf.low;
  node.high = leaf.high;
  leaves_.push_back(leaf);
}

/// Later leaves whose parts of the plan touch a leaf's, whatever gap lies between their points (the
/// rings of a scanner), unless it is out of proportion.
/// @param stack  memory for the work
void GroundTree::find_touching(std::size_t i, const Eigen::Array4f& part, std::vector<int>* stack,
                               std::vector<std::pair<int, int>>* pairs) const {
  constexpr float kWidestGap = 3.0f;
  const Leaf& leaf = leaves_[i];
  const float size = (leaf.high - leaf.low).maxCoeff();
  stack->assign(1, 0);
  while (!stack->empty()) {
    const Node& node = nodes_[static_cast<std::size_t>(stack->back())];
    stack->pop_back();
    if (node.leaf < 0) {
      if (part[2 + node.axis] >= node.split) stack->push_back(node.above);
      if (part[node.axis] <= node.split) stack->push_back(node.below);
      continue;
    }
    if (node.leaf <= static_cast<int>(i)) continue;
    const Leaf& other = leaves_[static_cast<std::size_t>(node.leaf)];
    const float gap = (leaf.low - other.high).max(other.low - leaf.high).max(0.0f).matrix().norm();
    if (gap <= kWidestGap * std::max(size, (other.high - other.low).maxCoeff())) {
      pairs->emplace_back(static_cast<int>(i), node.leaf);
    }
  }
}

/// Leaves whose boxes touch a leaf's: half its size bridges the gaps that chance leaves.
void GroundTree::find_near(std::size_t i, std::vector<int>* stack,
                           std::vector<std::pair<int, int>>* pairs) const {
  const Leaf& leaf = leaves_[i];
  const Eigen::Array2f size = (leaf.high - leaf.low).max(0.0f);
  const float reach = 0.5f * std::sqrt(std::max(size[0] * size[1], 0.0f)) + 1e-6f;
  const Eigen::Array2f low = leaf.low - reach, high = leaf.high + reach;
  stack->assign(1, 0);
  while (!stack->empty()) {
    const Node& node = nodes_[static_cast<std::size_t>(stack->back())];
    stack->pop_back();
    if ((node.low > high).any() || (node.high < low).any()) continue;
    if (node.leaf >= 0) {
      if (node.leaf != static_cast<int>(i)) pairs->emplace_back(static_cast<int>(i), node.leaf);
    } else {
      stack->push_back(node.above);
      stack->push_back(node.below);
    }
  }
}

void GroundTree::find_neighbours(int num_threads) {
  neighbours_.assign(leaves_.size(), {});
  if (nodes_.empty()) return;
  // The part of the plan that each leaf answers for.
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  std::vector<Eigen::Array4f> parts(nodes_.size());
  parts[0] = {-kInfinite, -kInfinite, kInfinite, kInfinite};
  std::vector<std::size_t> node_of(leaves_.size());
  for (std::size_t k = 0; k < nodes_.size(); ++k) {  // parents come before their children
    const Node& node = nodes_[k];
    if (node.leaf >= 0) {
      node_of[static_cast<std::size_t>(node.leaf)] = k;
      continue;
    }
    Eigen::Array4f &below = parts[static_cast<std::size_t>(node.below)],
                   &above = parts[static_cast<std::size_t>(node.above)];
    below = above = parts[k];
    below[2 + node.axis] = node.split;
    above[node.axis] = node.split;
  }
  constexpr std::size_t kBatch = 256;  // leaves
  using Pairs = std::vector<std::pair<int, int>>;
  std::vector<Pairs> lists((leaves_.size() + kBatch - 1) / kBatch);
  parallel_for(lists.size(), num_threads, [&](std::size_t batch) {
    std::vector<int> stack;
    const std::size_t end = std::min(leaves_.size(), (batch + 1) * kBatch);
    for (std::size_t i = batch * kBatch; i < end; ++i) {
      find_touching(i, parts[node_of[i]], &stack, &lists[batch]);
      find_near(i, &stack, &lists[batch]);
    }
  });
  Pairs pairs;
  for (const Pairs& list : lists) pairs.insert(pairs.end(), list.begin(), list.end());
  // Neighbourhood is mutual.
  std::vector<std::size_t> counts(leaves_.size(), 0);
  for (const auto& [a, b] : pairs) {
    ++counts[static_cast<std::size_t>(a)];
    ++counts[static_cast<std::size_t>(b)];
  }
  for (std::size_t i = 0; i < leaves_.size(); ++i) neighbours_[i].reserve(counts[i]);
  for (const auto& [a, b] : pairs) {
    neighbours_[static_cast<std::size_t>(a)].push_back(b);
    neighbours_[static_cast<std::size_t>(b)].push_back(a);
  }
  for (std::vector<int>& list : neighbours_) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
}

std::vector<std::uint64_t> GroundTree::keys(std::size_t first, std::size_t last) const {
  constexpr float kCellsAlong = 16.0f;
  Eigen::Array2f low = leaves_[first].low, high = leaves_[first].high;
  for (std::size_t leaf = first; leaf < last; ++leaf) {
    low = low.min(leaves_[leaf].low);
    high = high.max(leaves_[leaf].high);
  }
  // A power of two, so that it does not follow the extent.
  const float size = std::max((high - low).maxCoeff() / kCellsAlong, 1e-30f);
  const float per_cell = std::exp2(-std::floor(std::log2(size)));
  const auto cell = [&](float value) {
    return static_cast<std::uint64_t>(
        static_cast<std::int64_t>(std::floor(std::clamp(value * per_cell, -1e15f, 1e15f))));
  };
  std::vector<std::uint64_t> keys;
  for (std::size_t leaf = first; leaf < last; ++leaf) {
    for (std::size_t k = leaves_[leaf].begin; k < leaves_[leaf].end; ++k) {
      keys.push_back(hash_of(cell(points_.x[k]), cell(points_.y[k]), cell(points_.z[k])));
    }
  }
  return keys;
}

int GroundTree::entry(float x, float y) const {
  if (entries_.nodes.empty()) return nodes_.empty() ? -1 : 0;
  const int cell = entries_.cell(1, y) * Entries::kSide + entries_.cell(0, x);
  return entries_.nodes[static_cast<std::size_t>(cell)];
}

int GroundTree::locate_from(int entry, float x, float y) const {
  if (entry < 0) return -1;
  auto id = static_cast<std::size_t>(entry);
  while (nodes_[id].leaf < 0) {
    const Node& node = nodes_[id];
    const float value = node.axis == 0 ? x : y;
    id = static_cast<std::size_t>(value < node.split ? node.below : node.above);
  }
  return nodes_[id].leaf;
}

}  // namespace camber
