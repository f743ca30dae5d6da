#include "camber/cloud/point_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>

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
static_assert(sizeof(Entry) == 4 * sizeof(float), "four numbers side by side");

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

constexpr int kMostGrouped = 64;  // neighbours that are searched for a leaf's points together
constexpr int kMostRuns = 64;     // leaves that may hold them

/// The points of some leaves in the tree's order, a run of kLeafSize for each: what neighbours of
/// points that lie close together are chosen from. Runs end with points at infinity.
struct Candidates {
  int runs = 0;
  std::size_t leaves[kMostRuns];
  float x[kMostRuns * kLeafSize], y[kMostRuns * kLeafSize], z[kMostRuns * kLeafSize];
};

/// The leaves within a (squared) distance of a box, in their order.
/// @return their number, or -1 if they are more than kMostRuns
CAMBER_TARGET_CLONES("avx2")
int find_leaves(const PointTreeView& t, const detail::PointTreeBox& box, float reach,
                std::size_t* leaves) {
  const std::size_t first_leaf = std::size_t{1} << t.levels;
  std::size_t stack[kMostLevels + 2];
  int height = 1, found = 0;
  stack[0] = 1;
  while (height > 0) {
    const std::size_t node = stack[--height];
    if (gap(t.boxes[node], box.low, box.high) > reach) continue;
    if (node < first_leaf) {
      stack[height++] = 2 * node + 1;
      stack[height++] = 2 * node;
      continue;
    }
    if (found == kMostRuns) return -1;
    leaves[found++] = node - first_leaf;
  }
  return found;
}

void gather(const PointTreeView& t, Candidates& candidates) {
  for (int run = 0; run < candidates.runs; ++run) {
    const std::size_t leaf = candidates.leaves[run];
    const int begin = t.leaf_start[leaf], count = t.leaf_start[leaf + 1] - begin;
    float* const x = candidates.x + run * kLeafSize;
    std::memcpy(x, t.x + begin, kLeafSize * sizeof(float));
    std::memcpy(candidates.y + run * kLeafSize, t.y + begin, kLeafSize * sizeof(float));
    std::memcpy(candidates.z + run * kLeafSize, t.z + begin, kLeafSize * sizeof(float));
    for (int i = count; i < kLeafSize; ++i) x[i] = kInfinity;
  }
}

CAMBER_INLINE std::int32_t to_bits(float value) {
  std::int32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}
CAMBER_INLINE float from_bits(std::int32_t bits) {
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

using F8 = float __attribute__((vector_size(32)));
using I8 = std::int32_t __attribute__((vector_size(32)));

// Vectors are passed by reference: by value their calling convention would depend on the clone.
template <typename Vector, typename Number>
CAMBER_INLINE void load(const Number* from, Vector& to) {
  std::memcpy(&to, from, sizeof to);
}

CAMBER_INLINE std::int32_t least_of(const I8& a, const I8& b) {
  I8 least = a < b ? a : b;
  I8 other = __builtin_shufflevector(least, least, 4, 5, 6, 7, 0, 1, 2, 3);
  least = least < other ? least : other;
  other = __builtin_shufflevector(least, least, 2, 3, 0, 1, 6, 7, 4, 5);
  least = least < other ? least : other;
  other = __builtin_shufflevector(least, least, 1, 0, 3, 2, 5, 4, 7, 6);
  least = least < other ? least : other;
  return least[0];
}

/// Distances of a query to candidates as bits, which sort as the distances do, in runs as these.
struct CandidateDistances {
  int runs = 0;  ///< that reach into the bound
  int run[kMostRuns];
  std::int32_t least[kMostRuns];
  std::int32_t bits[kMostRuns * kLeafSize];

  CAMBER_INLINE int count_up_to(std::int32_t limit) const {
    std::int32_t count = 0;
    for (int i = 0; i < runs * kLeafSize; ++i) count += bits[i] <= limit ? 1 : 0;
    return count;
  }
};

/// The k candidates nearest to a query, by distance, equal ones by position.
/// @param k          at most kMostGrouped
/// @param bound      squared distance, finite
/// @param positions  receives k of them, as do the (squared) distances
/// @return whether so many are within the bound
CAMBER_TARGET_CLONES("avx2")
bool choose_nearest(const PointTreeView& t, const Candidates& candidates, const float* q, int k,
                    float bound, int* positions, float* distances) {
  CandidateDistances found;
  std::int32_t limit = to_bits(bound);
  static_assert(kLeafSize == 16, "two vectors");
  for (int run = 0; run < candidates.runs; ++run) {
    I8 halves[2];
    for (int half = 0; half < 2; ++half) {
      const int at = run * kLeafSize + 8 * half;
      F8 x, y, z;
      load(candidates.x + at, x);
      load(candidates.y + at, y);
      load(candidates.z + at, z);
      const F8 dx = x - q[0], dy = y - q[1], dz = z - q[2];
      const F8 squares = dx * dx + dy * dy + dz * dz;
      std::memcpy(&halves[half], &squares, sizeof squares);
    }
    std::memcpy(found.bits + found.runs * kLeafSize, halves, sizeof halves);
    const std::int32_t least = least_of(halves[0], halves[1]);
    found.run[found.runs] = run;
    found.least[found.runs] = least;
    found.runs += least <= limit ? 1 : 0;
  }
  // The distance of the k-th: more than `low` and at most `high`. On a surface the number within a
  // distance grows with its square, so that a few guesses find one within which there are k.
  int within_low = 0, within_high = found.count_up_to(limit);
  if (within_high < k) return false;
  std::int32_t low = -1, high = limit;
  for (int guess = 0; within_high > k && high - low > 1; ++guess) {
    std::int32_t middle = low + (high - low) / 2;
    if (guess < 8) {
      const float from = low < 0 ? 0.0f : from_bits(low);
      const float share = (static_cast<float>(k - within_low) - 0.5f) /
                          static_cast<float>(within_high - within_low);
      middle = to_bits(from + share * (from_bits(high) - from));
      middle = middle <= low ? low + 1 : middle >= high ? high - 1 : middle;
    }
    const int within = found.count_up_to(middle);
    if (within >= k) {
      high = middle;
      within_high = within;
    } else {
      low = middle;
      within_low = within;
    }
  }
  std::int32_t bits[kMostGrouped + kLeafSize];  // room for what is left out again
  int places[kMostGrouped + kLeafSize], count = 0;
  // All within `high`, or, where more than one of them is at the very distance of the k-th, of
  // these the first.
  const std::int32_t sure = within_high == k ? high : low;
  int left = k - (within_high == k ? k : within_low);
  for (int run = 0; run < found.runs; ++run) {
    if (found.least[run] > high) continue;
    const int begin = t.leaf_start[candidates.leaves[found.run[run]]];
    for (int i = 0; i < kLeafSize; ++i) {
      const std::int32_t here = found.bits[run * kLeafSize + i];
      const int tied = (here > sure) & (here <= high) & (left > 0) ? 1 : 0;
      bits[count] = here;
      places[count] = begin + i;
      count += here <= sure ? 1 : tied;
      left -= tied;
    }
  }
  // In order, by how many come before each: places are in order already.
  std::int32_t rank[kMostGrouped + 8];
  for (int first = 0; first < k; first += 8) {
    const I8 lanes = {0, 1, 2, 3, 4, 5, 6, 7};
    I8 here, before = {};
    load(bits + first, here);
    for (int i = 0; i < k; ++i) {
      // Equal ones come before those behind them.
      const I8 equal = (bits[i] == here) & (i < lanes + first);
      before -= (bits[i] < here) | equal;
    }
    std::memcpy(rank + first, &before, sizeof before);
  }
  for (int i = 0; i < k; ++i) {
    positions[rank[i]] = places[i];
    distances[rank[i]] = from_bits(bits[i]);
  }
  return true;
}

/// The nearest points of the points of one leaf after the other.
class LeafNeighborhoods {
 public:
  /// @param tree  whose ids are positions
  LeafNeighborhoods(const PointTreeView& tree, int k)
      : t_(tree),
        k_(k),
        items_(static_cast<std::size_t>(k)),
        positions_(static_cast<std::size_t>(k * kLeafSize)),
        distances_(positions_.size()) {}

  void search(std::size_t leaf) {
    begin_ = t_.leaf_start[leaf];
    count_ = t_.leaf_start[leaf + 1] - begin_;
    if (k_ > kMostGrouped || !search_together(leaf)) {
      for (int j = 0; j < count_; ++j) search_alone(leaf, j);
    }
  }
  /// Of the j-th point of the leaf, ascending.
  const int* positions(int j) const { return positions_.data() + j * k_; }
  const float* distances(int j) const { return distances_.data() + j * k_; }

 private:
  /// From the leaves that lie within a distance of this one, which the last leaf's neighbours
  /// suggest; farther ones where that is not enough. False where those are too many.
  bool search_together(std::size_t leaf) {
    constexpr float kMore = 1.3f;     // of the last leaf's squared distances
    constexpr float kFarther = 2.5f;  // squared
    constexpr float kRounding = 1e-5f;
    if (!(reach_ < kInfinity)) search_alone(leaf, 0);
    float reach = kMore * reach_, farthest = 0.0f;
    bool done[kLeafSize] = {};
    int left = count_;
    for (; left > 0; reach *= kFarther) {
      if (!(reach > 1e-30f && reach < 1e30f)) return false;
      const std::size_t node = (std::size_t{1} << t_.levels) + leaf;
      candidates_.runs = find_leaves(t_, t_.boxes[node], reach, candidates_.leaves);
      if (candidates_.runs < 0) return false;
      gather(t_, candidates_);
      for (int j = 0; j < count_; ++j) {
        if (done[j]) continue;
        const int at = begin_ + j;
        const float q[3] = {t_.x[at], t_.y[at], t_.z[at]};
        done[j] = choose_nearest(t_, candidates_, q, k_, reach * (1.0f - kRounding),
                                 positions_.data() + j * k_, distances_.data() + j * k_);
        if (!done[j]) continue;
        --left;
        farthest = std::max(farthest, distances(j)[k_ - 1]);
      }
    }
    reach_ = farthest;
    const int at = begin_ + count_ - 1;
    last_[0] = t_.x[at];
    last_[1] = t_.y[at];
    last_[2] = t_.z[at];
    return true;
  }

  /// By a walk through the tree of its own. The last point's neighbours bound those of the next,
  /// with room for rounding.
  void search_alone(std::size_t leaf, int j) {
    const int at = begin_ + j;
    const float q[4] = {t_.x[at], t_.y[at], t_.z[at], 0.0f};
    const float dx = q[0] - last_[0], dy = q[1] - last_[1], dz = q[2] - last_[2];
    const float bound = std::sqrt(reach_) + std::sqrt(dx * dx + dy * dy + dz * dz);
    Best best = start_best(items_.data(), k_, bound * bound * 1.001f + 1e-30f);
    search_own(t_, leaf, q, best);
    for (int i = 0; i < k_; ++i) {
      positions_[static_cast<std::size_t>(j * k_ + i)] = id_of(items_[static_cast<std::size_t>(i)]);
      distances_[static_cast<std::size_t>(j * k_ + i)] =
          distance_of(items_[static_cast<std::size_t>(i)]);
    }
    std::copy_n(q, 3, last_);
    reach_ = distances(j)[k_ - 1];
  }

  PointTreeView t_;
  int k_, begin_ = 0, count_ = 0;
  float last_[3] = {kInfinity, kInfinity, kInfinity};  ///< the last point
  float reach_ = kInfinity;  ///< no less than the squared distance of its k-th neighbour
  std::vector<std::uint64_t> items_;
  std::vector<int> positions_;
  std::vector<float> distances_;
  Candidates candidates_;
};

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

/// Four numbers side by side, so that a box grows by an entry in two instructions.
using Quad = float __attribute__((vector_size(16)));

detail::PointTreeBox box_of(const Entry* entries, const BuildNode& at) {
  Quad low = {kInfinity, kInfinity, kInfinity, kInfinity}, high = -low;
  for (std::size_t i = at.begin; i < at.end; ++i) {
    Quad place;  // the fourth is the index, and of no meaning
    std::memcpy(&place, &entries[i], sizeof place);
    low = place < low ? place : low;
    high = place > high ? place : high;
  }
  detail::PointTreeBox box;
  std::memcpy(box.low, &low, sizeof low);
  std::memcpy(box.high, &high, sizeof high);
  box.low[3] = box.high[3] = 0.0f;
  return box;
}

/// Moves the entries that are `before` to the front, without branches. @return how many there are
template <typename Before>
std::size_t part(Entry* entries, std::size_t count, const Before& before) {
  std::size_t cut = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Entry entry = entries[i];
    entries[i] = entries[cut];
    entries[cut] = entry;
    cut += before(entry) ? 1 : 0;
  }
  return cut;
}

/// Puts the entry of a rank along an axis (equal ones by index) in its place, smaller ones before
/// it, larger ones behind. By a sample it most likely lies between two values; only what is between
/// them is looked at again. Floyd, Rivest, "Expected time bounds for selection", CACM 1975.
void select(Entry* entries, std::size_t count, std::size_t rank, int axis) {
  constexpr std::size_t kFew = 256, kMostSamples = 512;
  while (count > kFew) {
    std::array<float, kMostSamples> sample;
    const std::size_t samples = std::min(kMostSamples, count / 8);
    for (std::size_t k = 0; k < samples; ++k) {
      sample[k] = entries[k * count / samples].p[axis];
    }
    const std::size_t middle = rank * samples / count;
    const auto margin = static_cast<std::size_t>(std::sqrt(static_cast<double>(samples)));
    const auto begin = sample.begin(), end = begin + static_cast<std::ptrdiff_t>(samples);
    const auto low_at = begin + static_cast<std::ptrdiff_t>(middle - std::min(margin, middle)),
               high_at =
                   begin + static_cast<std::ptrdiff_t>(std::min(middle + margin, samples - 1));
    std::nth_element(begin, low_at, end);
    const float low = *low_at;
    std::nth_element(low_at, high_at, end);
    const float high = *high_at;
    const std::size_t below = part(entries, count, [=](const Entry& e) { return e.p[axis] < low; });
    const std::size_t up_to = below + part(entries + below, count - below,
                                           [=](const Entry& e) { return e.p[axis] <= high; });
    const std::size_t before = count;
    if (rank < below) {
      count = below;
    } else if (rank >= up_to) {
      entries += up_to;
      rank -= up_to;
      count -= up_to;
    } else {
      entries += below;
      rank -= below;
      count = up_to - below;
    }
    if (2 * count > before) break;  // many at one place
  }
  std::nth_element(entries, entries + rank, entries + count,
                   [axis](const Entry& a, const Entry& b) {
                     return a.p[axis] < b.p[axis] || (a.p[axis] == b.p[axis] && a.index < b.index);
                   });
}

/// Sorts a node's entries into halves along its longest side. @return where the second starts
std::size_t split(const BuildNode& at, Entry* entries, detail::PointTreeBox& box) {
  box = box_of(entries, at);
  int axis = 0;
  for (int a = 1; a < 3; ++a) {
    if (box.high[a] - box.low[a] > box.high[axis] - box.low[axis]) axis = a;
  }
  const std::size_t middle = at.begin + (at.end - at.begin) / 2;
  select(entries + at.begin, at.end - at.begin, middle - at.begin, axis);
  return middle;
}

}  // namespace

PointTree::PointTree(const std::vector<Eigen::Vector3f>& points, int num_threads) {
  constexpr std::size_t kPiece = 65536;
  const std::size_t pieces = (points.size() + kPiece - 1) / kPiece;
  const auto for_each_finite = [&](std::size_t piece, const auto& visit) {
    const std::size_t end = std::min(points.size(), (piece + 1) * kPiece);
    for (std::size_t i = piece * kPiece; i < end; ++i) {
      if (points[i].allFinite()) visit(i);
    }
  };
  std::vector<std::size_t> starts(pieces + 1, 0);
  parallel_for(pieces, num_threads, [&](std::size_t piece) {
    for_each_finite(piece, [&](std::size_t) { ++starts[piece + 1]; });
  });
  for (std::size_t piece = 0; piece < pieces; ++piece) starts[piece + 1] += starts[piece];
  const std::size_t count = starts[pieces];
  const std::unique_ptr<Entry[]> memory(new Entry[count]);  // not cleared before it is filled
  Entry* const entries = memory.get();
  parallel_for(pieces, num_threads, [&](std::size_t piece) {
    std::size_t at = starts[piece];
    for_each_finite(piece, [&](std::size_t i) {
      entries[at++] = {{points[i].x(), points[i].y(), points[i].z()}, static_cast<int>(i)};
    });
  });
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
      const std::size_t middle = split(level[i], entries, boxes_[level[i].node]);
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
        boxes_[at.node] = box_of(entries, at);
        leaf_start_[at.node - leaves] = static_cast<int>(at.begin);
        continue;
      }
      const std::size_t middle = split(at, entries, boxes_[at.node]);
      stack.push_back({2 * at.node + 1, middle, at.end});
      stack.push_back({2 * at.node, at.begin, middle});
    }
  });
  // A leaf is read as kLeafSize points: behind the last one there are zeros.
  parallel_for(4, num_threads, [&](std::size_t array) {
    if (array == 3) {
      index_.resize(count);
      for (std::size_t i = 0; i < count; ++i) index_[i] = entries[i].index;
      return;
    }
    std::vector<float>& out = array == 0 ? x_ : array == 1 ? y_ : z_;
    out.reserve(count + kLeafSize);
    for (std::size_t i = 0; i < count; ++i) out.push_back(entries[i].p[array]);
    out.resize(count + kLeafSize);
  });
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
    LeafNeighborhoods near(tree, k);
    const std::size_t end = std::min(leaves, (block + 1) * kBlock);
    for (std::size_t leaf = block * kBlock; leaf < end; ++leaf) {
      near.search(leaf);
      const int begin = leaf_start_[leaf], count = leaf_start_[leaf + 1] - begin;
      for (int j = 0; j < count; ++j) {
        const std::size_t at = static_cast<std::size_t>(begin + j);
        Neighborhood neighborhood;
        neighborhood.index = index_[at];
        neighborhood.point = {x_[at], y_[at], z_[at]};
        neighborhood.count = k;
        neighborhood.positions = near.positions(j);
        neighborhood.squared_distances = near.distances(j);
        visit(neighborhood);
      }
    }
  });
}

}  // namespace camber
