#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "camber/road/detail/leaf_evaluator.h"
#include "camber/road/detail/plane_proposals.h"

namespace camber::detail {

/// The leaves of a tree in planar regions: proposals grow into regions, which then compete for
/// leaves, are cut, joined and dropped. Members are up to date after each call but grow().
class RegionPartition {
 public:
  explicit RegionPartition(const LeafEvaluator& evaluator);

  const std::vector<PivotPlane>& planes() const { return planes_; }          ///< of the regions
  const std::vector<int>& leaf_region() const { return leaf_region_; }       ///< or -1
  const std::vector<std::vector<int>>& members() const { return members_; }  ///< leaves, ascending

  /// Lets proposals grow over leaves that no region has, the best first; whether any did.
  /// @param least_start  share of a proposal's leaves that must be free and on its plane
  bool grow(const std::vector<PlaneProposal>& proposals, double least_start);

  /// Every leaf goes to the cheapest of its own and its neighbours' planes; planes are refitted.
  void compete();

  /// Cuts regions in two where a second plane pays: ground that bends slowly lets a region grow
  /// over it leaf by leaf.
  bool split();

  /// Joins neighbouring regions that one plane explains about as well as two.
  bool merge();

  /// Drops regions with too few points, and those whose leaves the neighbours' planes explain
  /// almost as well.
  bool drop();

 private:
  struct Halves;

  void collect();
  int cheapest_region(std::size_t leaf, std::vector<std::pair<int, int>>* votes) const;
  bool cut(std::size_t region, Halves* halves) const;
  std::optional<PivotPlane> common_plane(std::size_t a, std::size_t b,
                                         const std::vector<double>& costs) const;
  std::vector<int> reach(const PivotPlane& plane, const std::vector<int>& from) const;
  double quieter(double cost, double points) const;
  double allowed_misfit(double points) const;

  const LeafEvaluator& evaluator_;
  const GroundTree& tree_;
  const SegmentationOptions& options_;
  std::vector<PivotPlane> planes_;
  std::vector<std::vector<int>> members_;
  std::vector<int> leaf_region_;
};

}  // namespace camber::detail
