#include "camber/road/detail/plane_proposals.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/random.h"
#include "camber/plane/detail/local_noise.h"

namespace camber::detail {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

void propose_planes(const LeafEvaluator& evaluator, std::size_t block,
                    std::vector<PlaneProposal>* proposals) {
  const GroundTree& tree = evaluator.tree();
  const PointArrays& s = tree.points();
  const SegmentationNoise& noise = evaluator.noise();
  constexpr int kSamples = 40;
  const GroundTree::Block& range = tree.blocks()[block];
  const GroundTree::Leaf& head = tree.leaves()[range.first];
  const GroundTree::Leaf& tail = tree.leaves()[range.last - 1];
  const std::size_t begin = head.begin, end = tail.padded_end, n = end - begin;
  std::vector<float> weights(s.w.begin() + static_cast<long>(begin),
                             s.w.begin() + static_cast<long>(end));
  std::vector<float> scored(weights);
  std::vector<std::size_t> rows;
  for (std::size_t k = begin; k < end; ++k) {
    if (tree.cloud_index()[k] != GroundTree::kPadding) rows.push_back(k);
  }
  std::vector<std::uint64_t> keys(n);
  const std::vector<std::uint64_t> known = tree.keys(range.first, range.last);
  for (std::size_t k = 0; k < rows.size(); ++k) keys[rows[k] - begin] = known[k];
  const CounterRandom random(evaluator.options().seed, range.name);
  const double least_cosine = std::cos(evaluator.options().max_slope);
  std::uint64_t counter = 0;
  KeyedDraws draws;
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
      const Vector3d p = s.point(i), a = s.point(j) - p, b = s.point(k) - p;
      const Vector3d cross = a.cross(b);
      const double norm = cross.norm();
      if (!(norm > 1e-3 * std::max(a.squaredNorm(), b.squaredNorm()))) continue;
      PivotPlane plane;
      plane.n = cross.z() < 0.0 ? Vector3d(-cross / norm) : Vector3d(cross / norm);
      if (plane.n.z() < least_cosine) continue;
      plane.d = -plane.n.dot(p);
      if (noise.stated.kind == NoiseKind::kRays) {
        scored = weights;
        noise.noise.weigh(plane.n, plane.d, n, &s.x[begin], &s.y[begin], &s.z[begin],
                          &s.sigma[begin], nullptr, scored.data());
      }
      const double cost = static_cast<double>(kernels::msac_cost(
          {&s.x[begin], &s.y[begin], &s.z[begin], scored.data(), n}, plane.as_float(),
          static_cast<float>(kLeafLimit), static_cast<float>(std::min(best, 1e30))));
      if (cost < best) {
        best = cost;
        best_plane = plane;
      }
    }
    if (!std::isfinite(best)) return;
    PlaneProposal proposal;
    proposal.plane = best_plane;
    proposal.leaves = leaves;
    if (!evaluator.refit(leaves, 3, &proposal.plane)) proposal.plane = best_plane;
    // Its inliers, which the next turn leaves out.
    double inliers = 0.0;
    std::vector<std::size_t> rest;
    if (noise.stated.kind == NoiseKind::kRays) {
      scored = weights;
      noise.noise.weigh(proposal.plane.n, proposal.plane.d, n, &s.x[begin], &s.y[begin],
                        &s.z[begin], &s.sigma[begin], nullptr, scored.data());
    }
    for (const std::size_t k : rows) {
      const double r = proposal.plane.distance(s.point(k));
      const double t = r * r * static_cast<double>(scored[k - begin]);
      if (t < kLeafLimit) {
        inliers += 1.0;
        proposal.gain += kLeafLimit - t;
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

void propose_beside(const LeafEvaluator& evaluator, std::size_t leaf,
                    const std::vector<PivotPlane>& planes, const std::vector<int>& leaf_region,
                    std::vector<PlaneProposal>* proposals) {
  const GroundTree& tree = evaluator.tree();
  std::vector<int> group(1, static_cast<int>(leaf));
  std::vector<int> beside;
  for (const int other : tree.neighbours()[leaf]) {
    const int region = leaf_region[static_cast<std::size_t>(other)];
    if (region < 0) {
      group.push_back(other);
    } else if (std::find(beside.begin(), beside.end(), region) == beside.end()) {
      beside.push_back(region);
    }
  }
  std::sort(group.begin(), group.end());
  const double points = evaluator.points(group);
  PlaneProposal best;
  for (const int region : beside) {
    PivotPlane plane = planes[static_cast<std::size_t>(region)];
    // Wide at first: the ground bends away.
    bool good = true;
    for (const double limit :
         {16.0 * kLeafLimit, 8.0 * kLeafLimit, 4.0 * kLeafLimit, 2.0 * kLeafLimit}) {
      PlaneWindow window;
      align(plane, &window);
      double step = 0.0;
      const kernels::Moments m = evaluator.moments(plane, window, group, limit);
      good = m.count >= kLeastShare * points && solve_step(m, window, &plane, &step) &&
             plane.n.z() >= std::cos(evaluator.options().max_slope);
      if (!good) break;
    }
    if (!good) continue;
    PlaneProposal proposal;
    proposal.plane = plane;
    proposal.leaves = group;
    std::size_t accepted = 0;
    for (const int member : group) {
      const auto l = static_cast<std::size_t>(member);
      const kernels::PieceStatistics stats = evaluator.statistics(plane, l);
      if (!evaluator.accepts(stats, l)) continue;
      ++accepted;
      proposal.gain += evaluator.cost_without(l) - static_cast<double>(stats.cost);
    }
    if (2 * accepted >= group.size() && proposal.gain > best.gain) best = std::move(proposal);
  }
  if (best.gain > 0.0) proposals->push_back(std::move(best));
}

}  // namespace camber::detail
