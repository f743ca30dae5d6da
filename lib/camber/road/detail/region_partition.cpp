#include "camber/road/detail/region_partition.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "camber/core/threads.h"

namespace camber::detail {

namespace kernels = plane_kernels;

namespace {

constexpr double kSmoothness = 4.0;  // cost of a leaf whose neighbours are all of other regions
constexpr double kNewPlane = 10.0;   // cost that a plane of its own must save

}  // namespace

RegionPartition::RegionPartition(const LeafEvaluator& evaluator)
    : evaluator_(evaluator),
      tree_(evaluator.tree()),
      options_(evaluator.options()),
      leaf_region_(evaluator.tree().leaves().size(), -1) {}

/// How much smaller the variance at a place is than the whole cloud's, from the cost of its
/// points on the planes that fit them best: 1 where it is not, and no smaller than the ground's
/// roughness.
double RegionPartition::quieter(double cost, double points) const {
  constexpr double kNormal = 0.93, kMost = 16.0;  // cost of a point with normal noise
  const double typical = evaluator_.noise().typical;
  double most = typical > 0.0 ? kMost : 1.0;
  if (options_.roughness > 0.0) {
    const double ratio = typical / options_.roughness;
    most = std::clamp(ratio * ratio, 1.0, most);
  }
  return std::clamp(kNormal * points / std::max(cost, 1e-9), 1.0, most);
}

/// Misfit that the points of a region may have, as a cost: chance, and for each point a third of
/// the tolerance, or all of it where the points' errors are in common and bend the ground.
double RegionPartition::allowed_misfit(double points) const {
  const SegmentationNoise& noise = evaluator_.noise();
  const double share = (1.0 + 8.0 * noise.shared) / 9.0;
  return kNewPlane + points * noise.tolerance * noise.tolerance * share;
}

/// Leaves on a plane that hang together with the given ones; those that have a region are
/// left out.
std::vector<int> RegionPartition::reach(const PivotPlane& plane,
                                        const std::vector<int>& from) const {
  std::vector<int> found;
  std::vector<char> seen(tree_.leaves().size(), 0);
  std::vector<int> queue;
  const auto visit = [&](int leaf) {
    if (seen[static_cast<std::size_t>(leaf)]) return;
    seen[static_cast<std::size_t>(leaf)] = 1;
    if (leaf_region_[static_cast<std::size_t>(leaf)] >= 0) return;
    const auto index = static_cast<std::size_t>(leaf);
    if (!evaluator_.accepts(evaluator_.statistics(plane, index), index)) return;
    queue.push_back(leaf);
    found.push_back(leaf);
  };
  for (const int leaf : from) visit(leaf);
  while (!queue.empty()) {
    const int leaf = queue.back();
    queue.pop_back();
    for (const int next : tree_.neighbours()[static_cast<std::size_t>(leaf)]) visit(next);
  }
  std::sort(found.begin(), found.end());
  return found;
}

bool RegionPartition::grow(const std::vector<PlaneProposal>& proposals, double least_start) {
  std::vector<std::size_t> order(proposals.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t l, std::size_t r) {
    return proposals[l].gain > proposals[r].gain;
  });
  const std::size_t before = planes_.size();
  for (const std::size_t index : order) {
    const PlaneProposal& proposal = proposals[index];
    std::vector<int> start;
    for (const int member : proposal.leaves) {
      const auto leaf = static_cast<std::size_t>(member);
      if (leaf_region_[leaf] < 0 &&
          evaluator_.accepts(evaluator_.statistics(proposal.plane, leaf), leaf)) {
        start.push_back(member);
      }
    }
    if (start.empty() || static_cast<double>(start.size()) <
                             least_start * static_cast<double>(proposal.leaves.size())) {
      continue;
    }
    PivotPlane plane = proposal.plane;
    std::vector<int> region = start;
    for (int round = 0; round < 8; ++round) {
      std::vector<int> next = reach(plane, round == 0 ? start : region);
      if (next.size() < 2) {
        region = next;
        break;
      }
      PivotPlane refined = plane;
      if (!evaluator_.refit(next, 2, &refined)) break;
      plane = refined;
      const bool settled = next == region;
      region.swap(next);
      if (settled) break;
    }
    double points = 0.0;
    for (const int leaf : region) {
      points +=
          static_cast<double>(evaluator_.statistics(plane, static_cast<std::size_t>(leaf)).inliers);
    }
    if (points < options_.min_points) continue;
    const int id = static_cast<int>(planes_.size());
    planes_.push_back(plane);
    for (const int leaf : region) leaf_region_[static_cast<std::size_t>(leaf)] = id;
  }
  return planes_.size() > before;
}

void RegionPartition::collect() {
  members_.assign(planes_.size(), {});
  for (std::size_t leaf = 0; leaf < leaf_region_.size(); ++leaf) {
    const int region = leaf_region_[leaf];
    if (region >= 0) members_[static_cast<std::size_t>(region)].push_back(static_cast<int>(leaf));
  }
}

/// The cheapest region for a leaf of its own and its neighbours', or -1.
/// @param votes  memory for the work: region, neighbours of it
int RegionPartition::cheapest_region(std::size_t leaf,
                                     std::vector<std::pair<int, int>>* votes) const {
  votes->clear();
  const std::vector<int>& around = tree_.neighbours()[leaf];
  const auto vote = [&](int region, int number) {
    if (region < 0) return;
    for (auto& [known, votes_of] : *votes) {
      if (known == region) {
        votes_of += number;
        return;
      }
    }
    votes->emplace_back(region, number);
  };
  for (const int other : around) vote(leaf_region_[static_cast<std::size_t>(other)], 1);
  vote(leaf_region_[leaf], 0);
  int best_region = -1;
  double best = std::numeric_limits<double>::infinity();
  for (const auto& [region, number] : *votes) {
    const PivotPlane& plane = planes_[static_cast<std::size_t>(region)];
    const kernels::PieceStatistics stats = evaluator_.statistics(plane, leaf);
    if (!evaluator_.accepts(stats, leaf)) continue;
    const double alone =
        around.empty() ? 0.0
                       : 1.0 - static_cast<double>(number) / static_cast<double>(around.size());
    const double cost = static_cast<double>(stats.cost) + kSmoothness * alone;
    if (cost < best) {
      best = cost;
      best_region = region;
    }
  }
  return best_region;
}

void RegionPartition::compete() {
  const std::size_t count = tree_.leaves().size();
  for (int round = 0; round < 3; ++round) {
    collect();
    parallel_for(planes_.size(), options_.num_threads, [&](std::size_t region) {
      if (members_[region].size() >= 2) evaluator_.refit(members_[region], 2, &planes_[region]);
    });
    std::size_t changes = 0;
    std::vector<std::pair<int, int>> votes;  // region, neighbours of it
    for (std::size_t leaf = 0; leaf < count; ++leaf) {
      const int best_region = cheapest_region(leaf, &votes);
      if (best_region != leaf_region_[leaf]) {
        leaf_region_[leaf] = best_region;
        ++changes;
      }
    }
    if (changes * 200 < count) break;
  }
  collect();
}

/// A region in two parts.
struct RegionPartition::Halves {
  std::vector<int> rest;  // leaves of the second
  PivotPlane first, second;
};

/// The best cut of a region across or along it; false if none pays.
bool RegionPartition::cut(std::size_t region, Halves* halves) const {
  const std::vector<int>& members = members_[region];
  if (members.size() < 4) return false;
  double before = 0.0, points = 0.0;
  Eigen::Array2d mean = Eigen::Array2d::Zero();
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  std::vector<Eigen::Vector2d> middles;
  for (const int leaf : members) {
    const GroundTree::Leaf& l = tree_.leaves()[static_cast<std::size_t>(leaf)];
    before += evaluator_.cost(static_cast<std::size_t>(leaf), planes_[region]);
    points += static_cast<double>(l.end - l.begin);
    middles.emplace_back(0.5 * (l.low + l.high).cast<double>().matrix());
    mean += middles.back().array() / static_cast<double>(members.size());
  }
  if (points < 2.0 * options_.min_points) return false;
  for (const Eigen::Vector2d& m : middles) {
    const Eigen::Vector2d d = m - mean.matrix();
    scatter += d * d.transpose();
  }
  const double angle = 0.5 * std::atan2(2.0 * scatter(0, 1), scatter(0, 0) - scatter(1, 1));
  double best = allowed_misfit(points);
  halves->rest.clear();
  for (const double turn : {0.0, 0.5 * M_PI}) {
    const Eigen::Vector2d along(std::cos(angle + turn), std::sin(angle + turn));
    std::vector<double> places;
    for (const Eigen::Vector2d& m : middles) places.push_back(along.dot(m));
    std::vector<double> ordered = places;
    std::nth_element(ordered.begin(), ordered.begin() + static_cast<long>(ordered.size() / 2),
                     ordered.end());
    const double middle = ordered[ordered.size() / 2];
    std::vector<int> near, rest;
    for (std::size_t k = 0; k < members.size(); ++k) {
      (places[k] < middle ? near : rest).push_back(members[k]);
    }
    if (near.size() < 2 || rest.size() < 2) continue;
    const double near_points = evaluator_.points(near);
    if (std::min(near_points, points - near_points) < 1.5 * options_.min_points) continue;
    PivotPlane a = planes_[region], b = planes_[region];
    if (!evaluator_.refit(near, 3, &a) || !evaluator_.refit(rest, 3, &b)) continue;
    double after = 0.0;
    for (const int leaf : near) after += evaluator_.cost(static_cast<std::size_t>(leaf), a);
    for (const int leaf : rest) after += evaluator_.cost(static_cast<std::size_t>(leaf), b);
    // In units of the noise here: it may be less than the whole cloud's.
    const double gain = (before - after) * quieter(after, points);
    if (gain > best) {
      best = gain;
      halves->rest = rest;
      halves->first = a;
      halves->second = b;
    }
  }
  return !halves->rest.empty();
}

bool RegionPartition::split() {
  bool any = false;
  const std::size_t count = planes_.size();
  std::vector<Halves> cuts(count);
  std::vector<char> pays(count, 0);
  parallel_for(count, options_.num_threads,
               [&](std::size_t region) { pays[region] = cut(region, &cuts[region]) ? 1 : 0; });
  for (std::size_t region = 0; region < count; ++region) {
    if (pays[region] == 0) continue;
    const Halves& halves = cuts[region];
    for (const int leaf : halves.rest) {
      leaf_region_[static_cast<std::size_t>(leaf)] = static_cast<int>(planes_.size());
    }
    planes_[region] = halves.first;
    planes_.push_back(halves.second);
    any = true;
  }
  collect();
  return any;
}

/// The plane of two regions together, if it does for both.
/// @param costs  of the regions on their own planes
std::optional<PivotPlane> RegionPartition::common_plane(std::size_t a, std::size_t b,
                                                        const std::vector<double>& costs) const {
  if (planes_[a].n.dot(planes_[b].n) < std::cos(0.1)) return std::nullopt;
  std::vector<int> both = members_[a];
  both.insert(both.end(), members_[b].begin(), members_[b].end());
  PivotPlane plane = members_[a].size() >= members_[b].size() ? planes_[a] : planes_[b];
  if (!evaluator_.refit(both, 3, &plane)) return std::nullopt;
  const double apart = costs[a] + costs[b], points = evaluator_.points(both);
  const double more = quieter(apart, points), allowed = allowed_misfit(points);
  const std::size_t refused = both.size() - both.size() * 95 / 100;  // leaves, at most
  double together = 0.0;
  std::size_t off = 0;
  for (const int leaf : both) {
    const auto l = static_cast<std::size_t>(leaf);
    const kernels::PieceStatistics stats = evaluator_.statistics(plane, l);
    together += static_cast<double>(stats.cost);
    off += evaluator_.accepts(stats, l) ? 0 : 1;
    // No leaf costs less than nothing.
    if ((together - apart) * more > allowed || off > refused) return std::nullopt;
  }
  return plane;
}

bool RegionPartition::merge() {
  std::vector<std::pair<int, int>> pairs;
  for (std::size_t leaf = 0; leaf < leaf_region_.size(); ++leaf) {
    const int a = leaf_region_[leaf];
    if (a < 0) continue;
    for (const int other : tree_.neighbours()[leaf]) {
      const int b = leaf_region_[static_cast<std::size_t>(other)];
      if (b > a) pairs.emplace_back(a, b);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  std::vector<double> costs(planes_.size(), 0.0);
  parallel_for(planes_.size(), options_.num_threads, [&](std::size_t region) {
    for (const int leaf : members_[region]) {
      costs[region] += evaluator_.cost(static_cast<std::size_t>(leaf), planes_[region]);
    }
  });
  std::vector<std::optional<PivotPlane>> common(pairs.size());
  parallel_for(pairs.size(), options_.num_threads, [&](std::size_t k) {
    common[k] = common_plane(static_cast<std::size_t>(pairs[k].first),
                             static_cast<std::size_t>(pairs[k].second), costs);
  });
  bool any = false;
  std::vector<char> changed(planes_.size(), 0);
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const auto a = static_cast<std::size_t>(pairs[k].first),
               b = static_cast<std::size_t>(pairs[k].second);
    if (!common[k] || changed[a] || changed[b]) continue;
    for (const int leaf : members_[b]) {
      leaf_region_[static_cast<std::size_t>(leaf)] = static_cast<int>(a);
    }
    planes_[a] = *common[k];
    changed[a] = changed[b] = 1;
    any = true;
  }
  collect();
  return any;
}

bool RegionPartition::drop() {
  bool any = false;
  for (std::size_t region = 0; region < planes_.size(); ++region) {
    if (members_[region].empty()) continue;
    double points = 0.0, saved = 0.0;
    std::vector<int> instead;
    for (const int leaf : members_[region]) {
      const auto l = static_cast<std::size_t>(leaf);
      const kernels::PieceStatistics stats = evaluator_.statistics(planes_[region], l);
      points += static_cast<double>(stats.inliers);
      double best = evaluator_.cost_without(l);
      int best_region = -1;
      for (const int other : tree_.neighbours()[l]) {
        const int candidate = leaf_region_[static_cast<std::size_t>(other)];
        if (candidate < 0 || candidate == static_cast<int>(region)) continue;
        const kernels::PieceStatistics there =
            evaluator_.statistics(planes_[static_cast<std::size_t>(candidate)], l);
        if (!evaluator_.accepts(there, l)) continue;
        if (static_cast<double>(there.cost) < best) {
          best = static_cast<double>(there.cost);
          best_region = candidate;
        }
      }
      instead.push_back(best_region);
      saved += best - static_cast<double>(stats.cost);
    }
    if (points >= options_.min_points && saved > kNewPlane) continue;
    for (std::size_t k = 0; k < members_[region].size(); ++k) {
      leaf_region_[static_cast<std::size_t>(members_[region][k])] = instead[k];
    }
    collect();
    any = true;
  }
  return any;
}

}  // namespace camber::detail
