#include "camber/cloud/point_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "camber/cloud/morton.h"
#include "camber/core/threads.h"

// The searches are compiled twice: for machines with AVX2 and for all others. Sanitizers start too
// late for the function that chooses between them.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_TWO_TARGETS __attribute__((target_clones("arch=haswell", "default")))
#else
#define CAMBER_TWO_TARGETS
#endif
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

template <typename Result>
CAMBER_INLINE void scan_leaf(const PointTreeView& t, std::size_t leaf, const float* q,
                             Result& result) {
  const int begin = t.leaf_start[leaf], count = t.leaf_start[leaf + 1] - begin;
  const float* const x = t.x + begin;
  const float* const y = t.y + begin;
  const float* const z = t.z + begin;
  float distances[kLeafSize];
  for (int i = 0; i < count; ++i) {
    const float dx = x[i] - q[0], dy = y[i] - q[1], dz = z[i] - q[2];
    distances[i] = dx * dx + dy * dy + dz * dz;
  }
  for (int i = 0; i < count; ++i) {
    if (distances[i] <= result.limit) {
      result.add(pack(distances[i], t.ids != nullptr ? t.ids[begin + i] : begin + i));
    }
  }
}

/// Squared distance to a box, 0 inside.
CAMBER_INLINE float box_distance(const detail::PointTreeBox& box, const float* q) {
  float sum = 0.0f;
  for (int a = 0; a < 4; ++a) {
    const float below = box.low[a] - q[a], above = q[a] - box.high[a];
    const float outside = std::max(std::max(below, above), 0.0f);
    sum += outside * outside;
  }
  return sum;
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

CAMBER_TWO_TARGETS void search_best(const PointTreeView& t, const float* q, Best& best) {
  search_below(t, 1, 0.0f, q, best);
}

CAMBER_TWO_TARGETS void search_ball(const PointTreeView& t, const float* q, Ball& ball) {
  search_below(t, 1, 0.0f, q, ball);
}

/// The neighbours of one of the tree's points: its own leaf first, then up from there.
CAMBER_TWO_TARGETS void search_own(const PointTreeView& t, std::size_t leaf, const float* q,
                                   Best& best) {
  scan_leaf(t, leaf, q, best);
  for (std::size_t node = (std::size_t{1} << t.levels) + leaf; node > 1; node /= 2) {
    const float bound = box_distance(t.boxes[node ^ 1], q);
    if (bound <= best.limit) search_below(t, node ^ 1, bound, q, best);
  }
}

bool nearer(const PointTree::Neighbor& a, const PointTree::Neighbor& b) {
  return a.squared_distance < b.squared_distance ||
         (a.squared_distance == b.squared_distance && a.index < b.index);
}

}  // namespace

PointTree::PointTree(const std::vector<Eigen::Vector3f>& points) {
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
  struct BuildNode {
    std::size_t node, begin, end;
  };
  std::vector<BuildNode> stack = {{1, 0, count}};
  while (!stack.empty()) {
    const BuildNode at = stack.back();
    stack.pop_back();
    detail::PointTreeBox& box = boxes_[at.node];
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
    if (at.node >= leaves) {
      leaf_start_[at.node - leaves] = static_cast<int>(at.begin);
      continue;
    }
    int axis = 0;
    for (int a = 1; a < 3; ++a) {
      if (box.high[a] - box.low[a] > box.high[axis] - box.low[axis]) axis = a;
    }
    const std::size_t middle = at.begin + (at.end - at.begin) / 2;
    const auto place = [&](std::size_t i) {
      return entries.begin() + static_cast<std::ptrdiff_t>(i);
    };
    std::nth_element(
        place(at.begin), place(middle), place(at.end), [axis](const Entry& a, const Entry& b) {
          return a.p[axis] < b.p[axis] || (a.p[axis] == b.p[axis] && a.index < b.index);
        });
    stack.push_back({2 * at.node + 1, middle, at.end});
    stack.push_back({2 * at.node, at.begin, middle});
  }
  x_.resize(count);
  y_.resize(count);
  z_.resize(count);
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

std::vector<PointTree::Neighbor> PointTree::nearest_of_all(
    const std::vector<Eigen::Vector3f>& queries, int num_threads) const {
  std::vector<Neighbor> out(queries.size());
  if (size() == 0) return out;
  const std::vector<int> order = morton_order(queries);
  constexpr std::size_t kBlock = 4096;
  PointTreeView tree = view();
  tree.ids = nullptr;
  parallel_for((order.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    Eigen::Vector3f last = Eigen::Vector3f::Constant(kInfinity);  // the last query's neighbour
    const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const Eigen::Vector3f& query = queries[static_cast<std::size_t>(order[i])];
      if (!query.allFinite()) continue;
      // That point is near this query too. Its distance is a bound, with room for rounding.
      const float hint = (last - query).squaredNorm() * 1.001f + 1e-30f;
      std::uint64_t item = 0;
      Best best = start_best(&item, 1, hint);
      const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
      search_best(tree, q, best);
      if (best.count == 0) continue;  // distances beyond the range of float
      const std::size_t at = static_cast<std::size_t>(id_of(item));
      last = {x_[at], y_[at], z_[at]};
      out[static_cast<std::size_t>(order[i])] = {index_[at], distance_of(item)};
    }
  });
  return out;
}

std::vector<PointTree::NearestPair> PointTree::nearest_pair_of_all(
    const std::vector<Eigen::Vector3f>& queries, int num_threads) const {
  std::vector<NearestPair> out(queries.size());
  if (size() == 0) return out;
  const std::vector<int> order = morton_order(queries);
  constexpr std::size_t kBlock = 4096;
  PointTreeView tree = view();
  tree.ids = nullptr;
  parallel_for((order.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    Eigen::Vector3f last[2] = {Eigen::Vector3f::Constant(kInfinity),
                               Eigen::Vector3f::Constant(kInfinity)};
    const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      const Eigen::Vector3f& query = queries[static_cast<std::size_t>(order[i])];
      if (!query.allFinite()) continue;
      // The last query's two neighbours are near this one too: the farther is a bound for both,
      // with room for rounding.
      const float hint =
          std::max((last[0] - query).squaredNorm(), (last[1] - query).squaredNorm()) * 1.001f +
          1e-30f;
      std::uint64_t items[2] = {};
      Best best = start_best(items, 2, hint);
      const float q[4] = {query.x(), query.y(), query.z(), 0.0f};
      search_best(tree, q, best);
      if (best.count == 0) continue;  // distances beyond the range of float
      NearestPair& pair = out[static_cast<std::size_t>(order[i])];
      pair.second_squared_distance = kInfinity;
      for (int k = 0; k < best.count; ++k) {
        const std::size_t at = static_cast<std::size_t>(id_of(items[k]));
        last[k] = {x_[at], y_[at], z_[at]};
        if (k == 0) {
          pair.index = index_[at];
          pair.squared_distance = distance_of(items[0]);
        } else {
          pair.second_squared_distance = distance_of(items[1]);
        }
      }
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
    for (std::size_t leaf = block * kBlock; leaf < end; ++leaf) {
      for (int p = leaf_start_[leaf]; p < leaf_start_[leaf + 1]; ++p) {
        const std::size_t at = static_cast<std::size_t>(p);
        const float query[4] = {x_[at], y_[at], z_[at], 0.0f};
        Best best = start_best(items.data(), k, kInfinity);
        search_own(tree, leaf, query, best);
        for (std::size_t i = 0; i < items.size(); ++i) {
          positions[i] = id_of(items[i]);
          distances[i] = distance_of(items[i]);
        }
        Neighborhood neighborhood;
        neighborhood.index = index_[at];
        neighborhood.point = {query[0], query[1], query[2]};
        neighborhood.count = k;
        neighborhood.positions = positions.data();
        neighborhood.squared_distances = distances.data();
        visit(neighborhood);
      }
    }
  });
}

}  // namespace camber
