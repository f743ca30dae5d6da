#pragma once

#include <vector>

#include "camber/road/detail/leaf_evaluator.h"

namespace camber::detail {

/// A plane that may become a region's.
struct PlaneProposal {
  PivotPlane plane;
  double gain = 0.0;        ///< how much less it costs than no plane
  std::vector<int> leaves;  ///< where it starts
};

/// Planes of one block: the best of some minimal samples, then the best of what that leaves.
void propose_planes(const LeafEvaluator& evaluator, std::size_t block,
                    std::vector<PlaneProposal>* proposals);

/// A plane for a leaf that no region has and those of its neighbours that none has either: that of
/// a region beside it, bent to fit.
/// @param planes       of the regions
/// @param leaf_region  index of a region for each leaf, or -1
void propose_beside(const LeafEvaluator& evaluator, std::size_t leaf,
                    const std::vector<PivotPlane>& planes, const std::vector<int>& leaf_region,
                    std::vector<PlaneProposal>* proposals);

}  // namespace camber::detail
