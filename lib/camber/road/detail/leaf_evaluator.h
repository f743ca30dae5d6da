#pragma once

#include <vector>

#include "camber/plane/plane_kernels.h"
#include "camber/plane/plane_solver.h"
#include "camber/road/detail/segmentation_noise.h"
#include "camber/road/ground_tree.h"
#include "camber/road/patch_segmentation.h"

namespace camber::detail {

inline constexpr double kLeafLimit = kInlierSigmas * kInlierSigmas;  ///< of MSAC, variances
inline constexpr double kLeastShare = 0.3;  ///< of a leaf's points that its plane must hold

/// How planes lie on leaves of a tree, by the weights that the noise gives their points. Costs are
/// truncated squares of distances in standard deviations (MSAC).
class LeafEvaluator {
 public:
  /// @param noise  read at every call, so that it may change
  LeafEvaluator(const GroundTree& tree, const SegmentationOptions& options,
                const SegmentationNoise& noise)
      : tree_(tree), options_(options), noise_(noise), s_(tree.points()) {}

  const GroundTree& tree() const { return tree_; }
  const SegmentationOptions& options() const { return options_; }
  const SegmentationNoise& noise() const { return noise_; }

  plane_kernels::PieceStatistics statistics(const PivotPlane& plane, std::size_t leaf) const;

  /// Sums for solve_step over the points of some leaves.
  plane_kernels::Moments moments(const PivotPlane& plane, const PlaneWindow& window,
                                 const std::vector<int>& leaves, double limit) const;

  /// A leaf is on a plane if enough of its points are, and their mean is not off by more than the
  /// tolerance and chance.
  bool accepts(const plane_kernels::PieceStatistics& stats, std::size_t leaf) const;

  /// Refines a plane on some leaves; false where it cannot be solved or gets too steep.
  bool refit(const std::vector<int>& leaves, int rounds, PivotPlane* plane) const;

  double cost(std::size_t leaf, const PivotPlane& plane) const {
    return static_cast<double>(statistics(plane, leaf).cost);
  }
  /// Cost of a leaf that no plane holds.
  double cost_without(std::size_t leaf) const { return kLeafLimit * points(leaf); }

  double points(std::size_t leaf) const {
    const GroundTree::Leaf& l = tree_.leaves()[leaf];
    return static_cast<double>(l.end - l.begin);
  }
  double points(const std::vector<int>& leaves) const {
    double sum = 0.0;
    for (const int leaf : leaves) sum += points(static_cast<std::size_t>(leaf));
    return sum;
  }

 private:
  plane_kernels::PieceStatistics statistics_by_rays(const PivotPlane& plane,
                                                    std::size_t leaf) const;

  const GroundTree& tree_;
  const SegmentationOptions& options_;
  const SegmentationNoise& noise_;
  const PointArrays& s_;
};

}  // namespace camber::detail
