#include "camber/road/detail/segmentation_noise.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/plane/detail/local_noise.h"

namespace camber::detail {

using Eigen::Vector3d;

namespace {

constexpr double kLimit = kInlierSigmas * kInlierSigmas;
// Scatter among neighbours, in stated deviations, from which on errors are independent, and up to
// which they are in common.
constexpr double kIndependent = 0.7, kInCommon = 0.35;

using LeafRange = std::pair<std::size_t, std::size_t>;  // [first, second)

/// Pieces of ground that show the noise: leaves of a block, together where they are small; some of
/// them, without the padding.
std::vector<LeafRange> choose_pieces(const GroundTree& tree) {
  constexpr std::size_t kPiecePoints = 28, kMostPieces = 96;
  std::vector<LeafRange> groups;
  for (const GroundTree::Block& block : tree.blocks()) {
    std::size_t from = block.first, count = 0;
    for (std::size_t leaf = block.first; leaf < block.last; ++leaf) {
      count += tree.leaves()[leaf].end - tree.leaves()[leaf].begin;
      if (count < kPiecePoints && leaf + 1 < block.last) continue;
      groups.emplace_back(from, leaf + 1);
      from = leaf + 1;
      count = 0;
    }
  }
  // By name, not by number: what changes at one place is to change nothing elsewhere.
  const auto name_of = [&](const LeafRange& group) { return tree.leaves()[group.first].name; };
  if (groups.size() > kMostPieces) {
    std::nth_element(groups.begin(), groups.begin() + kMostPieces, groups.end(),
                     [&](const auto& l, const auto& r) { return name_of(l) < name_of(r); });
    groups.resize(kMostPieces);
    std::sort(groups.begin(), groups.end());
  }
  return groups;
}

}  // namespace

SegmentationNoise learn_segmentation_noise(const SegmentationOptions& options, NoiseModel start,
                                           GroundTree* tree) {
  SegmentationNoise out;
  out.stated = std::move(start);
  PointArrays& s = tree->points();
  const std::vector<LeafRange> groups = choose_pieces(*tree);
  std::vector<std::uint32_t> rows;
  std::vector<std::pair<std::size_t, std::size_t>> pieces;
  for (const auto& group : groups) {
    const std::size_t begin = rows.size();
    for (std::size_t leaf = group.first; leaf < group.second; ++leaf) {
      const GroundTree::Leaf& l = tree->leaves()[leaf];
      for (std::size_t k = l.begin; k < l.end; ++k) rows.push_back(static_cast<std::uint32_t>(k));
    }
    pieces.emplace_back(begin, rows.size());
  }
  const double least = std::max({4e-7 * tree->spread(), 1e-9, out.stated.least});
  NoiseModel& noise = out.stated;
  if (options.noise_is_known) {
    out.shared = options.shared;
  } else {
    const auto learn = [&](NoiseModel* model) {
      PointArrays some;
      some.take(s, rows);
      std::vector<std::uint64_t> keys;
      for (const auto& [first, last] : groups) {
        const std::vector<std::uint64_t> more = tree->keys(first, last);
        keys.insert(keys.end(), more.begin(), more.end());
      }
      learn_local_noise(some, pieces, keys, Vector3d::UnitZ(), options.max_slope, least,
                        options.seed, options.num_threads, model);
    };
    if (options.inlier_threshold > 0.0) {
      noise.kind = NoiseKind::kSame;
      noise.scale = options.inlier_threshold / kInlierSigmas;
      NoiseModel local;
      learn(&local);
      out.local = local.scale;
    } else if (noise.kind == NoiseKind::kSame || noise.kind == NoiseKind::kPower) {
      learn(&noise);
    }
  }
  out.noise = noise;
  if (!(options.inlier_threshold > 0.0)) out.noise.least = std::max(noise.least, options.roughness);
  PivotPlane level;
  // Padding rows keep weight 0.
  for (const GroundTree::Leaf& leaf : tree->leaves()) {
    for (std::size_t k = leaf.begin; k < leaf.end; ++k) s.w[k] = 1.0f;
    const std::size_t b = leaf.begin;
    if (noise.kind == NoiseKind::kRays) continue;
    out.noise.weigh(level.n, level.d, leaf.end - b, &s.x[b], &s.y[b], &s.z[b],
                    s.sigma.empty() ? nullptr : &s.sigma[b],
                    s.covariance.empty() ? nullptr : &s.covariance[b], &s.w[b]);
  }
  std::vector<float> weights;
  for (std::size_t k = 0; k < s.w.size(); k += 7) {
    if (s.w[k] > 0.0f) weights.push_back(s.w[k]);
  }
  const double middle = weights.empty() ? 1.0 : quantile(weights, 0.5);
  out.typical = noise.kind == NoiseKind::kRays ? 0.0 : 1.0 / std::sqrt(middle);
  out.tolerance = options.tolerance_sigmas;
  if (out.typical > 0.0) {
    out.tolerance = std::max(out.tolerance, options.tolerance / out.typical);
  }
  return out;
}

void measure_shared(const GroundTree& tree, const SegmentationOptions& options,
                    const std::vector<PivotPlane>& planes, const std::vector<int>& leaf_region,
                    SegmentationNoise* noise) {
  const PointArrays& s = tree.points();
  if (noise->stated.kind != NoiseKind::kRays && noise->stated.kind != NoiseKind::kCovariance)
    return;
  if (options.noise_is_known || options.inlier_threshold > 0.0) return;
  constexpr double kFewest = 10.0;
  std::vector<float> ratios, weights;
  for (std::size_t leaf = 0; leaf < leaf_region.size(); ++leaf) {
    if (leaf_region[leaf] < 0) continue;
    const PivotPlane& plane = planes[static_cast<std::size_t>(leaf_region[leaf])];
    const GroundTree::Leaf& l = tree.leaves()[leaf];
    const std::size_t b = l.begin, n = l.end - l.begin;
    weights.assign(n, 1.0f);
    // As stated: without the ground's roughness.
    noise->stated.weigh(plane.n, plane.d, n, &s.x[b], &s.y[b], &s.z[b],
                        s.sigma.empty() ? nullptr : &s.sigma[b],
                        s.covariance.empty() ? nullptr : &s.covariance[b], weights.data());
    // Residuals about a plane of the leaf's own.
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    double squares = 0.0, count = 0.0, variance = 0.0;
    const Vector3d from = s.point(b);
    for (std::size_t k = 0; k < n; ++k) {
      const double r = plane.distance(s.point(b + k)), w = static_cast<double>(weights[k]);
      if (!(w > 0.0) || !(r * r * w < kLimit)) continue;
      const Vector3d p = s.point(b + k) - from;
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
  noise->shared = std::clamp((kIndependent - scatter) / (kIndependent - kInCommon), 0.0, 1.0);
}

}  // namespace camber::detail
