#include "camber/cloud/point_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"

#define CAMBER_INLINE __attribute__((always_inline)) inline

namespace camber {

namespace detail {
/// The tree as plain pointers, for the loops that are compiled twice.
struct PointTreeView {
  int levels;
  const PointTreeBox* boxes;
  const int* leaf_start;
  const float *x, *y, *z;
  const int* ids;  ///< what is found of a point: its original index, or nullptr for its position
};
}  // namespace detail

namespace {

using detail::PointTreeView;

constexpr int kLeafSize = 16;  // points, at most
constexpr int kMostLevels = 30;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Entry {
  float p[3];
  int index;
};

/// Distance and number in one integer that sorts by distance, then by number.
CAMBER_INLINE std::uint64_t pack(float squared_distance, int id) {
  std::uint32_t bits;
  std::memcpy(&bits, &squared_distance, sizeof bits);  // not negative: sorts as its bits do
  return static_cast<std::uint64_t>(bits) << 32 | static_cast<std::uint32_t>(id);
}
CAMBER_INLINE float distance_of(std::uint64_t packed) {
  const std::uint32_t bits = static_cast<std::uint32_t>(packed >> 32);
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
CAMBER_INLINE int id_of(std::uint64_t packed) {
  return static_cast<int>(static_cast<std::uint32_t>(packed));
}

/// The k nearest so far, ascending.
struct Best {
  std::uint64_t* items;
  int k;
  int count;
  std::uint64_t worst;  ///< what a candidate must be below
  float limit;          ///< the distance in `worst`

  CAMBER_INLINE void add(std::uint64_t candidate) {
    if (candidate >= worst) return;
    int at = count < k ? count++ : k - 1;
    while (at > 0 && items[at - 1] > candidate) {
      items[at] = items[at - 1];
      --at;
    }
    items[at] = candidate;
    if (count == k) {
      worst = std::min(worst, items[k - 1]);
      limit = distance_of(worst);
    }
  }
};

/// Starts with room for k points nearer than a squared distance.
CAMBER_INLINE Best start_best(std::uint64_t* items, int k, float limit) {
  return {items, k, 0, pack(limit, -1), limit};
}

/// All within a distance.
struct Ball {
  std::vector<PointTree::Neighbor>* out;
  float limit;
  int count;
  int enough;

  CAMBER_INLINE void add(std::uint64_t candidate) {
    ++count;
    if (out != nullptr) out->push_back({id_of(candidate), distance_of(candidate)});
    if (count >= enough) limit = -1.0f;
  }
};

/// Squared distances of a query to kLeafSize points from `begin` on as bits, which sort as the
/// distances do. @return the least of the first `count`
CAMBER_INLINE std::int32_t leaf_distances(const PointTreeView& t, int begin, int count,
                                          const float* q, std::int32_t* bits) {
  const float* const x = t.x + begin;
  const float* const y = t.y + begin;
  const float* const z = t.z + begin;
  float distances[kLeafSize];
  for (int i = 0; i < kLeafSize; ++i) {
    const float dx = x[i] - q[0], dy = y[i] - q[1], dz = z[i] - q[2];
    distances[i] = dx * dx + dy * dy + dz * dz;
  }
  std::memcpy(bits, distances, sizeof distances);
  std::int32_t least = std::numeric_limits<std::int32_t>::max();
  for (int i = 0; i < kLeafSize; ++i) {
    bits[i] = i < count ? bits[i] : std::numeric_limits<std::int32_t>::max();
    least = std::min(least, bits[i]);
  }
  return least;
}

template <typename Result>
CAMBER_INLINE void scan_leaf(const PointTreeView& t, std::size_t leaf, const float* q,
                             Result& result) {
  const int begin = t.leaf_start[leaf], count = t.leaf_start[leaf + 1] - begin;
  std::int32_t bits[kLeafSize], limit;
  std::memcpy(&limit, &result.limit, sizeof limit);
  if (leaf_distances(t, begin, count, q, bits) > limit) return;
  for (int i = 0; i < count; ++i) {
    std::memcpy(&limit, &result.limit, sizeof limit);
    if (bits[i] <= limit) {
      const std::uint64_t distance = static_cast<std::uint32_t>(bits[i]);
      const int id = t.ids != nullptr ? t.ids[begin + i] : begin + i;
      result.add(distance << 32 | static_cast<std::uint32_t>(id));
    }
  }
}

/// Squared distance between two boxes, 0 where they meet.
CAMBER_INLINE float gap(const detail::PointTreeBox& box, const float* low, const float* high) {
  float squares[4];
  for (int a = 0; a < 4; ++a) {
    const float below = box.low[a] - high[a], above = low[a] - box.high[a];
    const float more = below > above ? below : above;
    const float outside = more > 0.0f ? more : 0.0f;
    squares[a] = outside * outside;
  }
  return squares[0] + squares[1] + squares[2];
}

/// Squared distance to a box, 0 inside.
CAMBER_INLINE float box_distance(const detail::PointTreeBox& box, const float* q) {
  return gap(box, q, q);
}

/// Searches below `node`, whose box is `bound` away from the query (squared), nearer children
/// first. @param q four numbers, the last is 0
template <typename Result>
CAMBER_INLINE void search_below(const PointTreeView& t, std::size_t node, float bound,
                                const float* q, Result& result) {
  struct Pending {
    std::size_t node;
    float bound;
  };
  const std::size_t first_leaf = std::size_t{1} << t.levels;
  Pending stack[kMostLevels + 2];
  int height = 1;
  stack[0] = {node, bound};
  while (height > 0) {
    const Pending at = stack[--height];
    if (at.bound > result.limit) continue;
    std::size_t here = at.node;
    bool open = true;
    while (here < first_leaf) {
      const float first = box_distance(t.boxes[2 * here], q);
      const float second = box_distance(t.boxes[2 * here + 1], q);
      const bool swap = second < first;
      const float near = swap ? second : first, far = swap ? first : second;
      const std::size_t near_node = 2 * here + (swap ? 1 : 0);
      if (far <= result.limit) stack[height++] = {near_node ^ 1, far};
      if (near > result.limit) {
        open = false;
        break;
      }
      here = near_node;
    }
    if (open) scan_leaf(t, here - first_leaf, q, result);
  }
}

CAMBER_TARGET_CLONES("avx2") void search_best(const PointTreeView& t, const float* q, Best& best) {
  search_below(t, 1, 0.0f, q, best);
}

CAMBER_TARGET_CLONES("avx2") void search_ball(const PointTreeView& t, const float* q, Ball& ball) {
  search_below(t, 1, 0.0f, q, ball);
}

/// The neighbours of one of the tree's points: its own leaf first, then up from there.
CAMBER_TARGET_CLONES("avx2")
void search_own(const PointTreeView& t, std::size_t leaf, const float* q, Best& best) {
  scan_leaf(t, leaf, q, best);
  for (std::size_t node = (std::size_t{1} << t.levels) + leaf; node > 1; node /= 2) {
    const float bound = box_distance(t.boxes[node ^ 1], q);
    if (bound <= best.limit) search_below(t, node ^ 1, bound, q, best);
  }
}

/// Queries that lie close together, those of one leaf of another tree, and their two nearest
/// points. Behind the last of them the first is repeated.
struct QueryGroup {
  int count;
  float x[kLeafSize], y[kLeafSize], z[kLeafSize];
  float low[4], high[4], middle[4];           ///< their box
  float first[kLeafSize], second[kLeafSize];  ///< squared distances so far, or bounds
  int nearest[kLeafSize];                     ///< position; -1: none so far
  float limit;                                ///< the largest of the second ones
};

/// The points of a leaf, shifted, as queries without bounds yet.
void gather(const PointTreeView& t, std::size_t leaf, const Eigen::Vector3d& shift,
            QueryGroup& group) {
  const int begin = t.leaf_start[leaf];
  group.count = t.leaf_start[leaf + 1] - begin;
  const float* const from[3] = {t.x, t.y, t.z};
  float* const to[3] = {group.x, group.y, group.z};
  for (int a = 0; a < 3; ++a) {
    for (int j = 0; j < kLeafSize; ++j) {
      const int at = begin + (j < group.count ? j : 0);
      to[a][j] = static_cast<float>(static_cast<double>(from[a][at]) + shift[a]);
    }
    group.low[a] = *std::min_element(to[a], to[a] + kLeafSize);
    group.high[a] = *std::max_element(to[a], to[a] + kLeafSize);
    group.middle[a] = 0.5f * (group.low[a] + group.high[a]);
  }
  group.low[3] = group.high[3] = group.middle[3] = 0.0f;
}

/// The largest of kLeafSize numbers, none negative: their bits sort as they do.
CAMBER_INLINE float largest(const float* values) {
  std::int32_t bits[kLeafSize], most = 0;
  std::memcpy(bits, values, sizeof bits);
  for (int j = 0; j < kLeafSize; ++j) most = bits[j] > most ? bits[j] : most;
  float out;
  std::memcpy(&out, &most, sizeof out);
  return out;
}

CAMBER_INLINE void scan_leaf_for_group(const PointTreeView& t, std::size_t leaf,
                                       QueryGroup& group) {
  for (int i = t.leaf_start[leaf]; i < t.leaf_start[leaf + 1]; ++i) {
    const float x = t.x[i], y = t.y[i], z = t.z[i];
    for (int j = 0; j < kLeafSize; ++j) {
      const float dx = group.x[j] - x, dy = group.y[j] - y, dz = group.z[j] - z;
      const float d = dx * dx + dy * dy + dz * dz, first = group.first[j];
      const float rest = d < first ? first : d;
      group.second[j] = rest < group.second[j] ? rest : group.second[j];
      group.nearest[j] = d < first ? i : group.nearest[j];
      group.first[j] = d < first ? d : first;
    }
  }
  group.limit = largest(group.second);
}

/// Whether one walk for all queries of a group is worth while: they lie as close together as the
/// points that they ask for, and not far off.
CAMBER_TARGET_CLONES("avx2")
bool is_compact(const PointTreeView& t, const QueryGroup& group) {
  constexpr float kMostLeaves = 3.0f;  // lengths of the nearest leaf
  std::size_t node = 1;
  for (int level = 0; level < t.levels; ++level) {
    node *= 2;
    if (box_distance(t.boxes[node + 1], group.middle) < box_distance(t.boxes[node], group.middle)) {
      ++node;
    }
  }
  const detail::PointTreeBox& box = t.boxes[node];
  float across = 0.0f, own = 0.0f;  // squared diagonals
  for (int a = 0; a < 3; ++a) {
    across += (box.high[a] - box.low[a]) * (box.high[a] - box.low[a]);
    own += (group.high[a] - group.low[a]) * (group.high[a] - group.low[a]);
  }
  return std::sqrt(own) + std::sqrt(gap(box, group.low, group.high)) <=
         kMostLeaves * std::sqrt(across);
}

/// The neighbours of all queries of a group in one walk through the tree.
CAMBER_TARGET_CLONES("avx2") void search_group(const PointTreeView& t, QueryGroup& group) {
  struct Pending {
    std::size_t node;
    float bound;
  };
  const std::size_t first_leaf = std::size_t{1} << t.levels;
  Pending stack[kMostLevels + 2];
  int height = 1;
  stack[0] = {1, 0.0f};
  while (height > 0) {
    const Pending at = stack[--height];
    if (at.bound > group.limit) continue;
    std::size_t here = at.node;
    bool open = true;
    while (here < first_leaf) {
      const detail::PointTreeBox* const children = t.boxes + 2 * here;
      const bool swap =
          box_distance(children[1], group.middle) < box_distance(children[0], group.middle);
      const std::size_t near_node = 2 * here + (swap ? 1 : 0);
      const float far = gap(children[swap ? 0 : 1], group.low, group.high);
      if (far <= group.limit) stack[height++] = {near_node ^ 1, far};
      if (gap(children[swap ? 1 : 0], group.low, group.high) > group.limit) {
        open = false;
        break;
      }
      here = near_node;
    }
    if (open) scan_leaf_for_group(t, here - first_leaf, group);
  }
}

/// The neighbours of the queries of a group, one query after the other.
CAMBER_TARGET_CLONES("avx2")
void search_each(const PointTreeView& t, QueryGroup& group) {
  float hint = kInfinity;  // squared distance that holds two points for the query at hand
  for (int j = 0; j < group.count; ++j) {
    const float q[4] = {group.x[j], group.y[j], group.z[j], 0.0f};
    if (j > 0 && group.nearest[j - 1] >= 0) {
      const float dx = q[0] - group.x[j - 1], dy = q[1] - group.y[j - 1],
                  dz = q[2] - group.z[j - 1];
      const float reach = std::sqrt(group.second[j - 1]) + std::sqrt(dx * dx + dy * dy + dz * dz);
      hint = reach * reach * 1.001f + 1e-30f;
    }
    std::uint64_t items[2] = {};
    Best best = start_best(items, 2, std::min(hint, group.second[j]));
    search_below(t, 1, 0.0f, q, best);
    if (best.count > 0) {
      group.nearest[j] = id_of(items[0]);
      group.first[j] = distance_of(items[0]);
    }
    group.second[j] = best.count > 1 ? distance_of(items[1]) : kInfinity;
  }
}

bool nearer(const PointTree::Neighbor& a, const PointTree::Neighbor& b) {
  return a.squared_distance < b.squared_distance ||
         (a.squared_distance == b.squared_distance && a.index < b.index);
}

/// A node that is to be made, of the entries [begin, end).
struct BuildNode {
  std::size_t node, begin, end;
};

detail::PointTreeBox box_of(const Entry* entries, const BuildNode& at) {
  detail::PointTreeBox box;
  for (int a = 0; a < 3; ++a) {
    box.low[a] = kInfinity;
    box.high[a] = -kInfinity;
  }
  box.low[3] = box.high[3] = 0.0f;
  for (std::size_t i = at.begin; i < at.end; ++i) {
    for (int a = 0; a < 3; ++a) {
      box.low[a] = std::min(box.low[a], entries[i].p[a]);
      box.high[a] = std::max(box.high[a], entries[i].p[a]);
    }
  }
  return box;
}

/// Sorts a node's entries into halves along its longest side. @return where the second starts
std::size_t split(const BuildNode& at, Entry* entries, detail::PointTreeBox& box) {
  box = box_of(entries, at);
  int axis = 0;
  for (int a = 1; a < 3; ++a) {
    if (box.high[a] - box.low[a] > box.high[axis] - box.low[axis]) axis = a;
  }
  const std::size_t middle = at.begin + (at.end - at.begin) / 2;
  std::nth_element(entries + at.begin, entries + middle, entries + at.end,
                   [axis](const Entry& a, const Entry& b) {
                     return a.p[axis] < b.p[axis] || (a.p[axis] == b.p[axis] && a.index < b.index);
                   });
  return middle;
}

}  // namespace

PointTree::PointTree(const std::vector<Eigen::Vector3f>& points, int num_threads) {
  std::vector<Entry> entries;
  entries.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i];
    if (p.allFinite()) entries.push_back({{p.x(), p.y(), p.z()}, static_cast<int>(i)});
  }
  const std::size_t count = entries.size();
  while ((std::size_t{kLeafSize} << levels_) < count) ++levels_;
  const std::size_t leaves = std::size_t{1} << levels_;
  boxes_.resize(2 * leaves);
  leaf_start_.resize(leaves + 1);
  leaf_start_[leaves] = static_cast<int>(count);
  // The upper levels one after the other, then what is below side by side.
  constexpr int kTopLevels = 6;
  std::vector<BuildNode> level = {{1, 0, count}};
  for (int depth = 0; depth < std::min(levels_, kTopLevels); ++depth) {
    std::vector<BuildNode> next(2 * level.size());
    parallel_for(level.size(), num_threads, [&](std::size_t i) {
      const std::size_t middle = split(level[i], entries.data(), boxes_[level[i].node]);
      next[2 * i] = {2 * level[i].node, level[i].begin, middle};
      next[2 * i + 1] = {2 * level[i].node + 1, middle, level[i].end};
    });
    level = std::move(next);
  }
  parallel_for(level.size(), num_threads, [&](std::size_t i) {
    std::vector<BuildNode> stack = {level[i]};
    while (!stack.empty()) {
      const BuildNode at = stack.back();
      stack.pop_back();
      if (at.node >= leaves) {
        boxes_[at.node] = box_of(entries.data(), at);
        leaf_start_[at.node - leaves] = static_cast<int>(at.begin);
        continue;
      }
      const std::size_t middle = split(at, entries.data(), boxes_[at.node]);
      stack.push_back({2 * at.node + 1, middle, at.end});
      stack.push_back({2 * at.node, at.begin, middle});
    }
  });
  // A leaf is read as kLeafSize points: behind the last one there are zeros.
  x_.resize(count + kLeafSize);
  y_.resize(count + kLeafSize);
  z_.resize(count + kLeafSize);
  index_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    x_[i] = entries[i].p[0];
    y_[i] = entries[i].p[1];
    z_[i] = entries[i].p[2];
    index_[i] = entries[i].index;
  }
}

detail::PointTreeView PointTree::view() const {
  return {levels_,   boxes_.data(), leaf_start_.data(), x_.data(),
          y_.data(), z_.data(),     index_.data()};
}

void PointTree::nearest(const Eigen::Vector3f& query, int k, std::vector<Neighbor>& out) const {
  out.clear();
  k = static_cast<int>(std::min<std::size_t>(static_cast<std::size_t>(std::max(k, 0)), size()));
  if (k == 0 || !query.allFinite()) return;
  std::vector<std::uint64_t> items(static_cast<std::size_t>(k));
  Best best = start_best(items.data(), k, kInfinity);
  const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
  search_best(view(), q, best);
  out.reserve(items.size());
  for (int i = 0; i < best.count; ++i) {
    const std::uint64_t item = items[static_cast<std::size_t>(i)];
    out.push_back({id_of(item), distance_of(item)});
  }
}

PointTree::Neighbor PointTree::nearest(const Eigen::Vector3f& query, float largest_distance) const {
  if (size() == 0 || !query.allFinite()) return {};
  std::uint64_t item = 0;
  Best best = start_best(&item, 1, largest_distance * largest_distance);
  const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
  search_best(view(), q, best);
  if (best.count == 0) return {};
  return {id_of(item), distance_of(item)};
}

void PointTree::for_each_leaf_of(const PointTree& queries, const Eigen::Vector3d& shift,
                                 int num_threads,
                                 const std::function<void(const LeafNeighbors&)>& visit) const {
  if (size() == 0 || queries.size() == 0) return;
  PointTreeView tree = view();
  tree.ids = nullptr;
  const PointTreeView asking = queries.view();
  const std::size_t leaves = std::size_t{1} << queries.levels_;
  constexpr std::size_t kBlock = 256;  // leaves
  parallel_for((leaves + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    QueryGroup group;
    // The nearest point of the last query and the one before are near the next ones, too: the
    // farther is a bound for two neighbours, with room for rounding.
    Eigen::Vector3f last[2] = {Eigen::Vector3f::Constant(kInfinity),
                               Eigen::Vector3f::Constant(kInfinity)};
    int last_position = -1;
    const std::size_t end = std::min(leaves, (block + 1) * kBlock);
    for (std::size_t leaf = block * kBlock; leaf < end; ++leaf) {
      gather(asking, leaf, shift, group);
      for (int j = 0; j < kLeafSize; ++j) {
        const Eigen::Vector3f query(group.x[j], group.y[j], group.z[j]);
        group.first[j] = group.second[j] =
            std::max((last[0] - query).squaredNorm(), (last[1] - query).squaredNorm()) * 1.001f +
            1e-30f;
        group.nearest[j] = -1;
      }
      group.limit = largest(group.second);
      if (is_compact(tree, group)) {
        search_group(tree, group);
      } else {
        search_each(tree, group);
      }
      for (int j = 0; j < group.count; ++j) {
        if (group.nearest[j] < 0 || group.nearest[j] == last_position) continue;
        last_position = group.nearest[j];
        const std::size_t at = static_cast<std::size_t>(last_position);
        last[1] = last[0];
        last[0] = {x_[at], y_[at], z_[at]};
      }
      LeafNeighbors out;
      out.begin = queries.leaf_start_[leaf];
      out.count = group.count;
      out.x = group.x;
      out.y = group.y;
      out.z = group.z;
      out.positions = group.nearest;
      out.squared_distances = group.first;
      out.second_squared_distances = group.second;
      visit(out);
    }
  });
}

std::vector<PointTree::NearestPair> PointTree::nearest_pair_of_all(
    const std::vector<Eigen::Vector3f>& queries, int num_threads) const {
  std::vector<NearestPair> out(queries.size());
  const PointTree tree(queries, num_threads);
  for_each_leaf_of(tree, Eigen::Vector3d::Zero(), num_threads, [&](const LeafNeighbors& near) {
    for (int j = 0; j < near.count; ++j) {
      if (near.positions[j] < 0) continue;
      out[static_cast<std::size_t>(tree.index_[static_cast<std::size_t>(near.begin + j)])] = {
          index_[static_cast<std::size_t>(near.positions[j])], near.squared_distances[j],
          near.second_squared_distances[j]};
    }
  });
  return out;
}

void PointTree::within(const Eigen::Vector3f& query, float radius,
                       std::vector<Neighbor>& out) const {
  out.clear();
  if (size() == 0 || !query.allFinite() || !(radius >= 0.0f)) return;
  Ball ball{&out, radius * radius, 0, std::numeric_limits<int>::max()};
  const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
  search_ball(view(), q, ball);
  std::sort(out.begin(), out.end(), nearer);
}

int PointTree::count_within(const Eigen::Vector3f& query, float radius, int enough) const {
  if (size() == 0 || !query.allFinite() || !(radius >= 0.0f) || enough <= 0) return 0;
  Ball ball{nullptr, radius * radius, 0, enough};
  const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
  search_ball(view(), q, ball);
  return std::min(ball.count, enough);
}

void PointTree::for_each_neighborhood(int k, int num_threads,
                                      const std::function<void(const Neighborhood&)>& visit) const {
  k = static_cast<int>(std::min<std::size_t>(static_cast<std::size_t>(std::max(k, 0)), size()));
  if (k == 0) return;
  PointTreeView tree = view();
  tree.ids = nullptr;
  const std::size_t leaves = std::size_t{1} << levels_;
  constexpr std::size_t kBlock = 64;  // leaves
  parallel_for((leaves + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    std::vector<std::uint64_t> items(static_cast<std::size_t>(k));
    std::vector<int> positions(items.size());
    std::vector<float> distances(items.size());
    const std::size_t end = std::min(leaves, (block + 1) * kBlock);
    // The last point's k neighbours bound those of the next, with room for rounding.
    Eigen::Vector3f last = Eigen::Vector3f::Constant(kInfinity);
    float reach = kInfinity;
    for (std::size_t leaf = block * kBlock; leaf < end; ++leaf) {
      for (int p = leaf_start_[leaf]; p < leaf_start_[leaf + 1]; ++p) {
        const std::size_t at = static_cast<std::size_t>(p);
        const float query[4] = {x_[at], y_[at], z_[at], 0.0f};
        const Eigen::Vector3f point(x_[at], y_[at], z_[at]);
        const float bound = reach + (point - last).norm();
        Best best = start_best(items.data(), k, bound * bound * 1.001f + 1e-30f);
        search_own(tree, leaf, query, best);
        last = point;
        reach = std::sqrt(distance_of(items.back()));
        for (std::size_t i = 0; i < items.size(); ++i) {
          positions[i] = id_of(items[i]);
          distances[i] = distance_of(items[i]);
        }
        Neighborhood neighborhood;
        neighborhood.index = index_[at];
        neighborhood.point = point;
        neighborhood.count = k;
        neighborhood.positions = positions.data();
        neighborhood.squared_distances = distances.data();
        visit(neighborhood);
      }
    }
  });
}

}  // namespace camber
