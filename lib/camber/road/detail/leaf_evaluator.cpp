#include "camber/road/detail/leaf_evaluator.h"

#include <algorithm>
#include <cmath>

namespace camber::detail {

namespace kernels = plane_kernels;

kernels::PieceStatistics LeafEvaluator::statistics(const PivotPlane& plane,
                                                   std::size_t leaf) const {
  if (noise_.stated.kind == NoiseKind::kRays) return statistics_by_rays(plane, leaf);
  const GroundTree::Leaf& l = tree_.leaves()[leaf];
  const std::size_t b = l.begin, n = l.padded_end - b;
  return kernels::piece_statistics({&s_.x[b], &s_.y[b], &s_.z[b], &s_.w[b], n}, plane.as_float(),
                                   static_cast<float>(kLeafLimit));
}

/// Apart, since its memory for weights costs the others time.
kernels::PieceStatistics LeafEvaluator::statistics_by_rays(const PivotPlane& plane,
                                                           std::size_t leaf) const {
  const GroundTree::Leaf& l = tree_.leaves()[leaf];
  const std::size_t b = l.begin, n = l.padded_end - b;
  const float* const known = &s_.w[b];
  alignas(32) float rays[64];
  std::copy(known, known + n, rays);
  noise_.noise.weigh(plane.n, plane.d, n, &s_.x[b], &s_.y[b], &s_.z[b], &s_.sigma[b], nullptr,
                     rays);
  return kernels::piece_statistics({&s_.x[b], &s_.y[b], &s_.z[b], rays, n}, plane.as_float(),
                                   static_cast<float>(kLeafLimit));
}

kernels::Moments LeafEvaluator::moments(const PivotPlane& plane, const PlaneWindow& window,
                                        const std::vector<int>& leaves, double limit) const {
  kernels::Moments sum;
  alignas(32) float rays[kernels::kBlock];
  const kernels::Target target = {plane.as_float(), window.as_float(), static_cast<float>(limit)};
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
    if (noise_.stated.kind == NoiseKind::kRays) {
      std::copy(w, w + n, rays);
      noise_.noise.weigh(plane.n, plane.d, n, &s_.x[b], &s_.y[b], &s_.z[b], &s_.sigma[b], nullptr,
                         rays);
      w = rays;
    }
    kernels::accumulate({&s_.x[b], &s_.y[b], &s_.z[b], w, n}, target, kernels::Loss::kReweighted,
                        false, &sum);
  }
  return sum;
}

bool LeafEvaluator::accepts(const kernels::PieceStatistics& stats, std::size_t leaf) const {
  const GroundTree::Leaf& l = tree_.leaves()[leaf];
  const double count = static_cast<double>(l.end - l.begin);
  if (stats.inliers < 4.0f || static_cast<double>(stats.inliers) < kLeastShare * count)
    return false;
  const double z =
      static_cast<double>(stats.gradient) / std::sqrt(static_cast<double>(stats.weight));
  return std::abs(z) < 2.5 + noise_.tolerance * std::sqrt(static_cast<double>(stats.inliers));
}

bool LeafEvaluator::refit(const std::vector<int>& leaves, int rounds, PivotPlane* plane) const {
  for (int round = 0; round < rounds; ++round) {
    PlaneWindow window;
    align(*plane, &window);
    const kernels::Moments m = moments(*plane, window, leaves, 2.0 * kLeafLimit);
    double step = 0.0;
    PivotPlane next = *plane;
    if (!solve_step(m, window, &next, &step)) return round > 0;
    if (next.n.z() < std::cos(options_.max_slope)) return false;
    *plane = next;
  }
  return true;
}

}  // namespace camber::detail
