#include "camber/road/patch_segmentation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/plane/detail/local_noise.h"

namespace camber {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

const Vector3d kUp = Vector3d::UnitZ();
constexpr double kLimit = kInlierSigmas * kInlierSigmas;
constexpr double kLeastShare = 0.3;  // of a leaf's points that a plane must hold to have it
constexpr double kSmoothness = 4.0;  // cost of a leaf whose neighbours are all of other regions
constexpr double kNewPlane = 10.0;   // cost that a plane of its own must save
// Scatter among neighbours, in stated deviations, from which on errors are independent, and up to
// which they are in common.
constexpr double kIndependent = 0.7, kInCommon = 0.35;

struct Proposal {
  PivotPlane plane;
  double gain = 0.0;
  std::vector<int> leaves;  // where it starts
};

class Segmenter {
 public:
  Segmenter(GroundTree& tree, NoiseModel start, const SegmentationOptions& options)
      : tree_(tree), options_(options), s_(tree.points()) {
    out_.noise = std::move(start);
  }

  Segmentation run();

 private:
  void learn_noise();
  void measure_shared();
  kernels::PieceStatistics statistics(const PivotPlane& plane, std::size_t leaf) const;
  kernels::Moments moments(const PivotPlane& plane, const PlaneWindow& window,
                           const std::vector<int>& leaves, double limit) const;
  bool accepts(const kernels::PieceStatistics& stats, std::size_t leaf) const;
  bool refit(const std::vector<int>& leaves, int rounds, PivotPlane* plane) const;
  void propose(std::size_t block, std::vector<Proposal>* proposals) const;
  void propose_beside(std::size_t leaf, std::vector<Proposal>* proposals) const;
  bool grow(const std::vector<Proposal>& proposals, double least_start);
  std::vector<int> reach(const PivotPlane& plane, const std::vector<int>& from,
                         const std::vector<int>& taken) const;
  void compete();
  bool split();
  bool merge();
  bool drop();
  void collect();
  double cost_of(std::size_t leaf, const PivotPlane& plane) const {
    return static_cast<double>(statistics(plane, leaf).cost);
  }
  /// How much smaller the variance at a place is than the whole cloud's, from the cost of its
  /// points on the planes that fit them best: 1 where it is not, and no smaller than the ground's
  /// roughness.
  double quieter(double cost, double points) const {
    constexpr double kNormal = 0.93, kMost = 16.0;  // cost of a point with normal noise
    double most = out_.typical_noise > 0.0 ? kMost : 1.0;
    if (options_.roughness > 0.0) {
      const double ratio = out_.typical_noise / options_.roughness;
      most = std::clamp(ratio * ratio, 1.0, most);
    }
    return std::clamp(kNormal * points / std::max(cost, 1e-9), 1.0, most);
  }
  double points_of(const std::vector<int>& leaves) const {
    double points = 0.0;
    for (const int leaf : leaves) {
      const GroundTree::Leaf& l = tree_.leaves()[static_cast<std::size_t>(leaf)];
      points += static_cast<double>(l.end - l.begin);
    }
    return points;
  }
  /// Misfit that the points of a region may have, as a cost: chance, and for each point a third of
  /// the tolerance, or all of it where the points' errors are in common and bend the ground.
  double allowed_misfit(double points) const {
    const double share = (1.0 + 8.0 * out_.shared) / 9.0;
    return kNewPlane + points * tolerance_ * tolerance_ * share;
  }
  double nothing(std::size_t leaf) const {
    const GroundTree::Leaf& l = tree_.leaves()[leaf];
    return kLimit * static_cast<double>(l.end - l.begin);
  }

  GroundTree& tree_;
  const SegmentationOptions& options_;
  PointArrays& s_;
  Segmentation out_;
  NoiseModel noise_;        // with the ground's roughness
  double tolerance_ = 0.0;  // in standard deviations
  std::vector<PivotPlane> planes_;
  std::vector<std::vector<int>> members_;
};

void Segmenter::learn_noise() {
  // Pieces of ground that show the noise: leaves of a block, together where they are small; some of
  // them, without the padding.
  constexpr std::size_t kPiecePoints = 28, kMostPieces = 96;
  std::vector<std::pair<std::size_t, std::size_t>> groups;  // leaves [first, second)
  for (const GroundTree::Block& block : tree_.blocks()) {
    std::size_t from = block.first, count = 0;
    for (std::size_t leaf = block.first; leaf < block.last; ++leaf) {
      count += tree_.leaves()[leaf].end - tree_.leaves()[leaf].begin;
      if (count < kPiecePoints && leaf + 1 < block.last) continue;
      groups.emplace_back(from, leaf + 1);
      from = leaf + 1;
      count = 0;
    }
  }
  // By name, not by number: what changes at one place is to change nothing elsewhere.
  const auto name_of = [&](const std::pair<std::size_t, std::size_t>& group) {
    return tree_.leaves()[group.first].name;
  };
  if (groups.size() > kMostPieces) {
    std::nth_element(groups.begin(), groups.begin() + kMostPieces, groups.end(),
                     [&](const auto& l, const auto& r) { return name_of(l) < name_of(r); });
    groups.resize(kMostPieces);
    std::sort(groups.begin(), groups.end());
  }
  std::vector<std::uint32_t> rows;
  std::vector<std::pair<std::size_t, std::size_t>> pieces;
  for (const auto& group : groups) {
    const std::size_t begin = rows.size();
    for (std::size_t leaf = group.first; leaf < group.second; ++leaf) {
      const GroundTree::Leaf& l = tree_.leaves()[leaf];
      for (std::size_t k = l.begin; k < l.end; ++k) rows.push_back(static_cast<std::uint32_t>(k));
    }
    pieces.emplace_back(begin, rows.size());
  }
  const double least = std::max(4e-7 * tree_.spread(), 1e-9);
  NoiseModel& noise = out_.noise;
  if (options_.noise_is_known) {
    out_.shared = options_.shared;
  } else if (options_.inlier_threshold > 0.0) {
    noise.kind = NoiseKind::kSame;
    noise.scale = options_.inlier_threshold / kInlierSigmas;
  } else if (noise.kind == NoiseKind::kSame || noise.kind == NoiseKind::kPower) {
    PointArrays some;
    some.take(s_, rows);
    std::vector<std::uint64_t> keys;
    for (const auto& [first, last] : groups) {
      const std::vector<std::uint64_t> more = tree_.keys(first, last);
      keys.insert(keys.end(), more.begin(), more.end());
    }
    detail::learn_local_noise(some, pieces, keys, kUp, options_.max_slope, least, options_.seed,
                              &noise);
  }
  noise_ = noise;
  if (!(options_.inlier_threshold > 0.0)) noise_.least = std::max(noise.least, options_.roughness);
  PivotPlane level;
  // Padding rows keep weight 0.
  for (const GroundTree::Leaf& leaf : tree_.leaves()) {
    for (std::size_t k = leaf.begin; k < leaf.end; ++k) s_.w[k] = 1.0f;
    const std::size_t b = leaf.begin;
    if (noise.kind == NoiseKind::kRays) continue;
    noise_.weigh(level.n, level.d, leaf.end - b, &s_.x[b], &s_.y[b], &s_.z[b],
                 s_.sigma.empty() ? nullptr : &s_.sigma[b],
                 s_.covariance.empty() ? nullptr : &s_.covariance[b], &s_.w[b]);
  }
  std::vector<float> weights;
  for (std::size_t k = 0; k < s_.w.size(); k += 7) {
    if (s_.w[k] > 0.0f) weights.push_back(s_.w[k]);
  }
  const double middle = weights.empty() ? 1.0 : quantile(weights, 0.5);
  out_.typical_noise = noise.kind == NoiseKind::kRays ? 0.0 : 1.0 / std::sqrt(middle);
  tolerance_ = options_.tolerance_sigmas;
  if (out_.typical_noise > 0.0) {
    tolerance_ = std::max(tolerance_, options_.tolerance / out_.typical_noise);
  }
}

/// How much less points scatter about the ground of their own leaf than they are stated to, by the
/// planes of the regions.
void Segmenter::measure_shared() {
  if (out_.noise.kind != NoiseKind::kRays && out_.noise.kind != NoiseKind::kCovariance) return;
  if (options_.noise_is_known || options_.inlier_threshold > 0.0) return;
  constexpr double kFewest = 10.0;
  std::vector<float> ratios, weights;
  for (std::size_t leaf = 0; leaf < out_.leaf_region.size(); ++leaf) {
    if (out_.leaf_region[leaf] < 0) continue;
    const PivotPlane& plane = planes_[static_cast<std::size_t>(out_.leaf_region[leaf])];
    const GroundTree::Leaf& l = tree_.leaves()[leaf];
    const std::size_t b = l.begin, n = l.end - l.begin;
    weights.assign(n, 1.0f);
    // As stated: without the ground's roughness.
    out_.noise.weigh(plane.n, plane.d, n, &s_.x[b], &s_.y[b], &s_.z[b],
                     s_.sigma.empty() ? nullptr : &s_.sigma[b],
                     s_.covariance.empty() ? nullptr : &s_.covariance[b], weights.data());
    // Residuals about a plane of the leaf's own.
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    double squares = 0.0, count = 0.0, variance = 0.0;
    const Vector3d from = s_.point(b);
    for (std::size_t k = 0; k < n; ++k) {
      const double r = plane.distance(s_.point(b + k)), w = static_cast<double>(weights[k]);
      if (!(w > 0.0) || !(r * r * w < kLimit)) continue;
      const Vector3d p = s_.point(b + k) - from;
      const Vector3d row(1.0, p.x(), p.y());
      normal += row * row.transpose();
      right += r * row;
      squares += r * r;
      count += 1.0;
      variance += 1.0 / w;
    }
    if (count < kFewest) continue;
    const Vector3d solution = normal.ldlt().solve(right);
    if (!solution.allFinite()) continue;
    const double rest = std::max(squares - solution.dot(right), 0.0) / (count - 3.0);
    ratios.push_back(static_cast<float>(rest * count / variance));
  }
  if (ratios.empty()) return;
  const double scatter = std::sqrt(quantile(ratios, 0.5));
  out_.shared = std::clamp((kIndependent - scatter) / (kIndependent - kInCommon), 0.0, 1.0);
}

kernels::PieceStatistics Segmenter::statistics(const PivotPlane& plane, std::size_t leaf) const {
  const GroundTree::Leaf& l = tree_.leaves()[leaf];
  const std::size_t b = l.begin, n = l.padded_end - b;
  const float* w = &s_.w[b];
  alignas(32) float rays[64];
  if (out_.noise.kind == NoiseKind::kRays) {
    std::copy(w, w + n, rays);
    noise_.weigh(plane.n, plane.d, n, &s_.x[b], &s_.y[b], &s_.z[b], &s_.sigma[b], nullptr, rays);
    w = rays;
  }
  return kernels::piece_statistics(&s_.x[b], &s_.y[b], &s_.z[b], w, n, plane.as_float(),
                                   static_cast<float>(kLimit));
}

kernels::Moments Segmenter::moments(const PivotPlane& plane, const PlaneWindow& window,
                                    const std::vector<int>& leaves, double limit) const {
  kernels::Moments sum;
  alignas(32) float rays[kernels::kBlock];
  const kernels::FloatPlane p = plane.as_float();
  const kernels::Window f = window.as_float();
  for (std::size_t k = 0; k < leaves.size();) {
    // Leaves that follow each other are one run of rows.
    const std::size_t b = tree_.leaves()[static_cast<std::size_t>(leaves[k])].begin;
    std::size_t end = b;
    do {
      end = tree_.leaves()[static_cast<std::size_t>(leaves[k])].padded_end;
      ++k;
    } while (k < leaves.size() && leaves[k] == leaves[k - 1] + 1 &&
             tree_.leaves()[static_cast<std::size_t>(leaves[k])].padded_end - b <= kernels::kBlock);
    const std::size_t n = end - b;
    const float* w = &s_.w[b];
    if (out_.noise.kind == NoiseKind::kRays) {
      std::copy(w, w + n, rays);
      noise_.weigh(plane.n, plane.d, n, &s_.x[b], &s_.y[b], &s_.z[b], &s_.sigma[b], nullptr, rays);
      w = rays;
    }
    kernels::accumulate(&s_.x[b], &s_.y[b], &s_.z[b], w, n, p, f, static_cast<float>(limit),
                        kernels::Loss::kReweighted, false, &sum);
  }
  return sum;
}

/// A leaf is on a plane if enough of its points are, and their mean is not off by more than the
/// tolerance and chance.
bool Segmenter::accepts(const kernels::PieceStatistics& stats, std::size_t leaf) const {
  const GroundTree::Leaf& l = tree_.leaves()[leaf];
  const double count = static_cast<double>(l.end - l.begin);
  if (stats.inliers < 4.0f || static_cast<double>(stats.inliers) < kLeastShare * count)
    return false;
  const double z =
      static_cast<double>(stats.gradient) / std::sqrt(static_cast<double>(stats.weight));
  return std::abs(z) < 2.5 + tolerance_ * std::sqrt(static_cast<double>(stats.inliers));
}

bool Segmenter::refit(const std::vector<int>& leaves, int rounds, PivotPlane* plane) const {
  for (int round = 0; round < rounds; ++round) {
    PlaneWindow window;
    align(*plane, &window);
    const kernels::Moments m = moments(*plane, window, leaves, 2.0 * kLimit);
    double step = 0.0;
    PivotPlane next = *plane;
    if (!solve_step(m, window, &next, &step)) return round > 0;
    if (next.n.z() < std::cos(options_.max_slope)) return false;
    *plane = next;
  }
  return true;
}

/// Planes of one block: the best of some minimal samples, then the best of what that leaves.
void Segmenter::propose(std::size_t block, std::vector<Proposal>* proposals) const {
  constexpr int kSamples = 40;
  const GroundTree::Block& range = tree_.blocks()[block];
  const GroundTree::Leaf& head = tree_.leaves()[range.first];
  const GroundTree::Leaf& tail = tree_.leaves()[range.last - 1];
  const std::size_t begin = head.begin, end = tail.padded_end, n = end - begin;
  std::vector<float> weights(s_.w.begin() + static_cast<long>(begin),
                             s_.w.begin() + static_cast<long>(end));
  std::vector<float> scored(weights);
  std::vector<std::size_t> rows;
  for (std::size_t k = begin; k < end; ++k) {
    if (tree_.cloud_index()[k] != GroundTree::kPadding) rows.push_back(k);
  }
  std::vector<std::uint64_t> keys(n);
  const std::vector<std::uint64_t> known = tree_.keys(range.first, range.last);
  for (std::size_t k = 0; k < rows.size(); ++k) keys[rows[k] - begin] = known[k];
  const CounterRandom random(options_.seed, range.name);
  const double least_cosine = std::cos(options_.max_slope);
  std::uint64_t counter = 0;
  detail::KeyedDraws draws;
  std::vector<int> leaves;
  for (std::size_t leaf = range.first; leaf < range.last; ++leaf) {
    leaves.push_back(static_cast<int>(leaf));
  }
  for (int turn = 0; turn < 2 && rows.size() >= 12; ++turn) {
    double best = std::numeric_limits<double>::infinity();
    PivotPlane best_plane;
    draws.clear();
    for (const std::size_t k : rows) draws.add(keys[k - begin], static_cast<std::uint32_t>(k));
    for (int sample = 0; sample < kSamples; ++sample) {
      const std::size_t i = draws.draw(random.bits(counter)),
                        j = draws.draw(random.bits(counter + 1)),
                        k = draws.draw(random.bits(counter + 2));
      counter += 3;
      const Vector3d p = s_.point(i), a = s_.point(j) - p, b = s_.point(k) - p;
      const Vector3d cross = a.cross(b);
      const double norm = cross.norm();
      if (!(norm > 1e-3 * std::max(a.squaredNorm(), b.squaredNorm()))) continue;
      PivotPlane plane;
      plane.n = cross.z() < 0.0 ? Vector3d(-cross / norm) : Vector3d(cross / norm);
      if (plane.n.z() < least_cosine) continue;
      plane.d = -plane.n.dot(p);
      if (out_.noise.kind == NoiseKind::kRays) {
        scored = weights;
        noise_.weigh(plane.n, plane.d, n, &s_.x[begin], &s_.y[begin], &s_.z[begin],
                     &s_.sigma[begin], nullptr, scored.data());
      }
      const double cost = static_cast<double>(kernels::msac_cost(
          &s_.x[begin], &s_.y[begin], &s_.z[begin], scored.data(), n, plane.as_float(),
          static_cast<float>(kLimit), static_cast<float>(std::min(best, 1e30))));
      if (cost < best) {
        best = cost;
        best_plane = plane;
      }
    }
    if (!std::isfinite(best)) return;
    Proposal proposal;
    proposal.plane = best_plane;
    proposal.leaves = leaves;
    if (!refit(leaves, 3, &proposal.plane)) proposal.plane = best_plane;
    // Its inliers, which the next turn leaves out.
    double inliers = 0.0;
    std::vector<std::size_t> rest;
    if (out_.noise.kind == NoiseKind::kRays) {
      scored = weights;
      noise_.weigh(proposal.plane.n, proposal.plane.d, n, &s_.x[begin], &s_.y[begin], &s_.z[begin],
                   &s_.sigma[begin], nullptr, scored.data());
    }
    for (const std::size_t k : rows) {
      const double r = proposal.plane.distance(s_.point(k));
      const double t = r * r * static_cast<double>(scored[k - begin]);
      if (t < kLimit) {
        inliers += 1.0;
        proposal.gain += kLimit - t;
        weights[k - begin] = 0.0f;
        scored[k - begin] = 0.0f;
      } else {
        rest.push_back(k);
      }
    }
    if (inliers >= 12.0) proposals->push_back(proposal);
    rows.swap(rest);
  }
}

/// Leaves on a plane that hang together with the given ones; leaves with taken[leaf] >= 0 are left
/// out.
std::vector<int> Segmenter::reach(const PivotPlane& plane, const std::vector<int>& from,
                                  const std::vector<int>& taken) const {
  std::vector<int> found;
  std::vector<char> seen(tree_.leaves().size(), 0);
  std::vector<int> queue;
  const auto visit = [&](int leaf) {
    if (seen[static_cast<std::size_t>(leaf)]) return;
    seen[static_cast<std::size_t>(leaf)] = 1;
    if (taken[static_cast<std::size_t>(leaf)] >= 0) return;
    const auto index = static_cast<std::size_t>(leaf);
    if (!accepts(statistics(plane, index), index)) return;
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

/// A plane for a leaf that no region has and those of its neighbours that none has either: that of
/// a region beside it, bent to fit.
void Segmenter::propose_beside(std::size_t leaf, std::vector<Proposal>* proposals) const {
  std::vector<int> group(1, static_cast<int>(leaf));
  std::vector<int> beside;
  for (const int other : tree_.neighbours()[leaf]) {
    const int region = out_.leaf_region[static_cast<std::size_t>(other)];
    if (region < 0) {
      group.push_back(other);
    } else if (std::find(beside.begin(), beside.end(), region) == beside.end()) {
      beside.push_back(region);
    }
  }
  std::sort(group.begin(), group.end());
  double points = 0.0;
  for (const int member : group) {
    const GroundTree::Leaf& l = tree_.leaves()[static_cast<std::size_t>(member)];
    points += static_cast<double>(l.end - l.begin);
  }
  Proposal best;
  for (const int region : beside) {
    PivotPlane plane = planes_[static_cast<std::size_t>(region)];
    // Wide at first: the ground bends away.
    bool good = true;
    for (const double limit : {16.0 * kLimit, 8.0 * kLimit, 4.0 * kLimit, 2.0 * kLimit}) {
      PlaneWindow window;
      align(plane, &window);
      double step = 0.0;
      const kernels::Moments m = moments(plane, window, group, limit);
      good = m.count >= kLeastShare * points && solve_step(m, window, &plane, &step) &&
             plane.n.z() >= std::cos(options_.max_slope);
      if (!good) break;
    }
    if (!good) continue;
    Proposal proposal;
    proposal.plane = plane;
    proposal.leaves = group;
    std::size_t accepted = 0;
    for (const int member : group) {
      const auto l = static_cast<std::size_t>(member);
      const kernels::PieceStatistics stats = statistics(plane, l);
      if (!accepts(stats, l)) continue;
      ++accepted;
      proposal.gain += nothing(l) - static_cast<double>(stats.cost);
    }
    if (2 * accepted >= group.size() && proposal.gain > best.gain) best = std::move(proposal);
  }
  if (best.gain > 0.0) proposals->push_back(std::move(best));
}

/// Lets proposals grow over leaves that no region has, the best first; whether any did.
/// @param least_start  share of a proposal's leaves that must be free and on its plane
bool Segmenter::grow(const std::vector<Proposal>& proposals, double least_start) {
  std::vector<std::size_t> order(proposals.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t l, std::size_t r) {
    return proposals[l].gain > proposals[r].gain;
  });
  std::vector<int>& taken = out_.leaf_region;
  const std::size_t before = planes_.size();
  for (const std::size_t index : order) {
    const Proposal& proposal = proposals[index];
    std::vector<int> start;
    for (const int member : proposal.leaves) {
      const auto leaf = static_cast<std::size_t>(member);
      if (taken[leaf] < 0 && accepts(statistics(proposal.plane, leaf), leaf)) {
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
      std::vector<int> next = reach(plane, round == 0 ? start : region, taken);
      if (next.size() < 2) {
        region = next;
        break;
      }
      PivotPlane refined = plane;
      if (!refit(next, 2, &refined)) break;
      plane = refined;
      const bool settled = next == region;
      region.swap(next);
      if (settled) break;
    }
    double points = 0.0;
    for (const int leaf : region) {
      points += static_cast<double>(statistics(plane, static_cast<std::size_t>(leaf)).inliers);
    }
    if (points < options_.min_points) continue;
    const int id = static_cast<int>(planes_.size());
    planes_.push_back(plane);
    for (const int leaf : region) taken[static_cast<std::size_t>(leaf)] = id;
  }
  return planes_.size() > before;
}

void Segmenter::collect() {
  members_.assign(planes_.size(), {});
  for (std::size_t leaf = 0; leaf < out_.leaf_region.size(); ++leaf) {
    const int region = out_.leaf_region[leaf];
    if (region >= 0) members_[static_cast<std::size_t>(region)].push_back(static_cast<int>(leaf));
  }
}

/// Every leaf goes to the cheapest of its own and its neighbours' planes; planes are refitted.
void Segmenter::compete() {
  const std::size_t count = tree_.leaves().size();
  for (int round = 0; round < 3; ++round) {
    collect();
    for (std::size_t region = 0; region < planes_.size(); ++region) {
      if (members_[region].size() >= 2) refit(members_[region], 2, &planes_[region]);
    }
    std::size_t changes = 0;
    std::vector<std::pair<int, int>> votes;  // region, neighbours of it
    for (std::size_t leaf = 0; leaf < count; ++leaf) {
      votes.clear();
      const std::vector<int>& around = tree_.neighbours()[leaf];
      const auto vote = [&](int region, int number) {
        if (region < 0) return;
        for (auto& [known, votes_of] : votes) {
          if (known == region) {
            votes_of += number;
            return;
          }
        }
        votes.emplace_back(region, number);
      };
      for (const int other : around) vote(out_.leaf_region[static_cast<std::size_t>(other)], 1);
      vote(out_.leaf_region[leaf], 0);
      int best_region = -1;
      double best = std::numeric_limits<double>::infinity();
      for (const auto& [region, number] : votes) {
        const PivotPlane& plane = planes_[static_cast<std::size_t>(region)];
        const kernels::PieceStatistics stats = statistics(plane, leaf);
        if (!accepts(stats, leaf)) continue;
        const double alone =
            around.empty() ? 0.0
                           : 1.0 - static_cast<double>(number) / static_cast<double>(around.size());
        const double cost = static_cast<double>(stats.cost) + kSmoothness * alone;
        if (cost < best) {
          best = cost;
          best_region = region;
        }
      }
      if (best_region != out_.leaf_region[leaf]) {
        out_.leaf_region[leaf] = best_region;
        ++changes;
      }
    }
    if (changes * 200 < count) break;
  }
  collect();
}

/// Cuts regions in two where a second plane pays: ground that bends slowly lets a region grow over
/// it leaf by leaf.
bool Segmenter::split() {
  bool any = false;
  const std::size_t count = planes_.size();
  for (std::size_t region = 0; region < count; ++region) {
    const std::vector<int>& members = members_[region];
    if (members.size() < 4) continue;
    double before = 0.0, points = 0.0;
    Eigen::Array2d mean = Eigen::Array2d::Zero();
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    std::vector<Eigen::Vector2d> middles;
    for (const int leaf : members) {
      const GroundTree::Leaf& l = tree_.leaves()[static_cast<std::size_t>(leaf)];
      before += cost_of(static_cast<std::size_t>(leaf), planes_[region]);
      points += static_cast<double>(l.end - l.begin);
      middles.emplace_back(0.5 * (l.low + l.high).cast<double>().matrix());
      mean += middles.back().array() / static_cast<double>(members.size());
    }
    if (points < 2.0 * options_.min_points) continue;
    for (const Eigen::Vector2d& m : middles) {
      const Eigen::Vector2d d = m - mean.matrix();
      scatter += d * d.transpose();
    }
    const double angle = 0.5 * std::atan2(2.0 * scatter(0, 1), scatter(0, 0) - scatter(1, 1));
    double best = allowed_misfit(points);
    std::vector<int> best_rest;
    PivotPlane best_plane, best_other;
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
      const double near_points = points_of(near);
      if (std::min(near_points, points - near_points) < 1.5 * options_.min_points) continue;
      PivotPlane a = planes_[region], b = planes_[region];
      if (!refit(near, 3, &a) || !refit(rest, 3, &b)) continue;
      double after = 0.0;
      for (const int leaf : near) after += cost_of(static_cast<std::size_t>(leaf), a);
      for (const int leaf : rest) after += cost_of(static_cast<std::size_t>(leaf), b);
      // In units of the noise here: it may be less than the whole cloud's.
      const double gain = (before - after) * quieter(after, points);
      if (gain > best) {
        best = gain;
        best_rest = rest;
        best_plane = a;
        best_other = b;
      }
    }
    if (best_rest.empty()) continue;
    for (const int leaf : best_rest) {
      out_.leaf_region[static_cast<std::size_t>(leaf)] = static_cast<int>(planes_.size());
    }
    planes_[region] = best_plane;
    planes_.push_back(best_other);
    any = true;
  }
  collect();
  return any;
}

/// Joins neighbouring regions that one plane explains about as well as two.
bool Segmenter::merge() {
  std::map<std::pair<int, int>, int> borders;
  for (std::size_t leaf = 0; leaf < out_.leaf_region.size(); ++leaf) {
    const int a = out_.leaf_region[leaf];
    if (a < 0) continue;
    for (const int other : tree_.neighbours()[leaf]) {
      const int b = out_.leaf_region[static_cast<std::size_t>(other)];
      if (b > a) ++borders[{a, b}];
    }
  }
  bool any = false;
  std::vector<char> changed(planes_.size(), 0);
  for (const auto& [pair, border] : borders) {
    const auto a = static_cast<std::size_t>(pair.first), b = static_cast<std::size_t>(pair.second);
    if (changed[a] || changed[b]) continue;
    if (planes_[a].n.dot(planes_[b].n) < std::cos(0.1)) continue;
    std::vector<int> both = members_[a];
    both.insert(both.end(), members_[b].begin(), members_[b].end());
    PivotPlane plane = members_[a].size() >= members_[b].size() ? planes_[a] : planes_[b];
    if (!refit(both, 3, &plane)) continue;
    double together = 0.0, apart = 0.0;
    std::size_t accepted = 0;
    for (const std::size_t region : {a, b}) {
      for (const int leaf : members_[region]) {
        const auto l = static_cast<std::size_t>(leaf);
        const kernels::PieceStatistics stats = statistics(plane, l);
        together += static_cast<double>(stats.cost);
        apart += cost_of(l, planes_[region]);
        accepted += accepts(stats, l) ? 1 : 0;
      }
    }
    double points = 0.0;
    for (const int leaf : both) {
      const GroundTree::Leaf& l = tree_.leaves()[static_cast<std::size_t>(leaf)];
      points += static_cast<double>(l.end - l.begin);
    }
    if ((together - apart) * quieter(apart, points) > allowed_misfit(points) ||
        accepted < both.size() * 95 / 100)
      continue;
    for (const int leaf : members_[b]) {
      out_.leaf_region[static_cast<std::size_t>(leaf)] = static_cast<int>(a);
    }
    planes_[a] = plane;
    changed[a] = changed[b] = 1;
    any = true;
  }
  collect();
  return any;
}

/// Drops regions with too few points, and those whose leaves the neighbours' planes explain almost
/// as well.
bool Segmenter::drop() {
  bool any = false;
  for (std::size_t region = 0; region < planes_.size(); ++region) {
    if (members_[region].empty()) continue;
    double points = 0.0, saved = 0.0;
    std::vector<int> instead;
    for (const int leaf : members_[region]) {
      const auto l = static_cast<std::size_t>(leaf);
      const kernels::PieceStatistics stats = statistics(planes_[region], l);
      points += static_cast<double>(stats.inliers);
      double best = nothing(l);
      int best_region = -1;
      for (const int other : tree_.neighbours()[l]) {
        const int candidate = out_.leaf_region[static_cast<std::size_t>(other)];
        if (candidate < 0 || candidate == static_cast<int>(region)) continue;
        const kernels::PieceStatistics there =
            statistics(planes_[static_cast<std::size_t>(candidate)], l);
        if (!accepts(there, l)) continue;
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
      out_.leaf_region[static_cast<std::size_t>(members_[region][k])] = instead[k];
    }
    collect();
    any = true;
  }
  return any;
}

Segmentation Segmenter::run() {
  out_.leaf_region.assign(tree_.leaves().size(), -1);
  if (tree_.size() < 3) return std::move(out_);
  learn_noise();
  std::vector<std::vector<Proposal>> by_block(tree_.blocks().size());
  parallel_for(by_block.size(), options_.num_threads,
               [&](std::size_t block) { propose(block, &by_block[block]); });
  std::vector<Proposal> proposals;
  for (const std::vector<Proposal>& list : by_block) {
    proposals.insert(proposals.end(), list.begin(), list.end());
  }
  grow(proposals, 0.5);
  // What lies between regions: where the ground bends, none of the blocks' planes may fit it.
  for (int round = 0; round < 4; ++round) {
    std::vector<std::vector<Proposal>> by_leaf(out_.leaf_region.size());
    parallel_for(by_leaf.size(), options_.num_threads, [&](std::size_t leaf) {
      if (out_.leaf_region[leaf] < 0) propose_beside(leaf, &by_leaf[leaf]);
    });
    proposals.clear();
    for (std::vector<Proposal>& list : by_leaf) {
      proposals.insert(proposals.end(), list.begin(), list.end());
    }
    if (!grow(proposals, 0.5)) break;
  }
  measure_shared();
  for (int round = 0; round < 4; ++round) {
    compete();
    const bool parted = round < 3 && split();
    if (parted) compete();
    const bool dropped = drop();
    const bool merged = merge();
    if (!parted && !dropped && !merged) break;
  }
  compete();
  for (std::size_t region = 0; region < planes_.size(); ++region) {
    if (members_[region].empty()) continue;
    PlanarRegion result;
    result.candidate.plane = planes_[region];
    result.candidate.noise = out_.noise;
    result.leaves = members_[region];
    for (const int leaf : members_[region]) {
      result.points +=
          static_cast<double>(statistics(planes_[region], static_cast<std::size_t>(leaf)).inliers);
    }
    if (result.points < options_.min_points) {
      for (const int leaf : members_[region]) out_.leaf_region[static_cast<std::size_t>(leaf)] = -1;
      continue;
    }
    const int id = static_cast<int>(out_.regions.size());
    for (const int leaf : members_[region]) out_.leaf_region[static_cast<std::size_t>(leaf)] = id;
    out_.regions.push_back(std::move(result));
  }
  return std::move(out_);
}

}  // namespace

Segmentation segment_planes(GroundTree& tree, NoiseModel start,
                            const SegmentationOptions& options) {
  return Segmenter(tree, std::move(start), options).run();
}

}  // namespace camber
