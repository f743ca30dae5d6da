#include "camber/road/patch_segmentation.h"

#include "camber/core/threads.h"
#include "camber/road/detail/leaf_evaluator.h"
#include "camber/road/detail/plane_proposals.h"
#include "camber/road/detail/region_partition.h"
#include "camber/road/detail/segmentation_noise.h"

namespace camber {
namespace {

using detail::LeafEvaluator;
using detail::PlaneProposal;
using detail::RegionPartition;
using detail::SegmentationNoise;

/// One list of proposals out of many, which were found in parallel.
std::vector<PlaneProposal> join(const std::vector<std::vector<PlaneProposal>>& lists) {
  std::vector<PlaneProposal> out;
  for (const std::vector<PlaneProposal>& list : lists) {
    out.insert(out.end(), list.begin(), list.end());
  }
  return out;
}

/// New regions on leaves that have none, on planes like those beside them: where the ground bends,
/// none of the blocks' planes may fit it. False: there are none.
/// @param where  one a leaf, non-zero: it is looked at
bool grow_beside(const LeafEvaluator& evaluator, const std::vector<std::uint8_t>& where,
                 RegionPartition* partition) {
  const std::vector<int>& leaf_region = partition->leaf_region();
  std::vector<std::vector<PlaneProposal>> by_leaf(leaf_region.size());
  parallel_for(by_leaf.size(), evaluator.options().num_threads, [&](std::size_t leaf) {
    if (leaf_region[leaf] >= 0 || !where[leaf]) return;
    detail::propose_beside(evaluator, leaf, partition->planes(), leaf_region, &by_leaf[leaf]);
  });
  return partition->grow(join(by_leaf), 0.5);
}

/// Leaves that lost their region and lie between others: patches of them that touch two regions at
/// least. What borders on one is its rim.
/// @param before  leaf_region() when they had one
std::vector<std::uint8_t> gaps_between(const GroundTree& tree, const std::vector<int>& before,
                                       const std::vector<int>& leaf_region) {
  std::vector<std::uint8_t> out(leaf_region.size(), 0), seen(leaf_region.size(), 0);
  for (std::size_t start = 0; start < leaf_region.size(); ++start) {
    if (seen[start] || before[start] < 0 || leaf_region[start] >= 0) continue;
    std::vector<int> gap(1, static_cast<int>(start)), beside;
    seen[start] = 1;
    for (std::size_t i = 0; i < gap.size(); ++i) {
      for (const int other : tree.neighbours()[static_cast<std::size_t>(gap[i])]) {
        const auto at = static_cast<std::size_t>(other);
        if (leaf_region[at] >= 0) {
          beside.push_back(leaf_region[at]);
        } else if (before[at] >= 0 && !seen[at]) {
          seen[at] = 1;
          gap.push_back(other);
        }
      }
    }
    std::sort(beside.begin(), beside.end());
    const bool between = !beside.empty() && beside.front() != beside.back();
    for (const int leaf : gap) out[static_cast<std::size_t>(leaf)] = between;
  }
  return out;
}

/// Regions with enough points as the result has them; leaves of the others lose their region.
void write_regions(const LeafEvaluator& evaluator, const RegionPartition& partition,
                   Segmentation* out) {
  const std::vector<PivotPlane>& planes = partition.planes();
  const std::vector<std::vector<int>>& members = partition.members();
  for (std::size_t region = 0; region < planes.size(); ++region) {
    if (members[region].empty()) continue;
    PlanarRegion result;
    result.candidate.plane = planes[region];
    result.candidate.noise = out->noise;
    result.leaves = members[region];
    for (const int leaf : members[region]) {
      result.points += static_cast<double>(
          evaluator.statistics(planes[region], static_cast<std::size_t>(leaf)).inliers);
    }
    if (result.points < evaluator.options().min_points) {
      for (const int leaf : members[region]) out->leaf_region[static_cast<std::size_t>(leaf)] = -1;
      continue;
    }
    const int id = static_cast<int>(out->regions.size());
    for (const int leaf : members[region]) out->leaf_region[static_cast<std::size_t>(leaf)] = id;
    out->regions.push_back(std::move(result));
  }
}

}  // namespace

Segmentation segment_planes(GroundTree& tree, NoiseModel start,
                            const SegmentationOptions& options) {
  Segmentation out;
  out.leaf_region.assign(tree.leaves().size(), -1);
  if (tree.size() < 3) {
    out.noise = std::move(start);
    return out;
  }
  SegmentationNoise noise = detail::learn_segmentation_noise(options, std::move(start), &tree);
  const LeafEvaluator evaluator(tree, options, noise);
  RegionPartition partition(evaluator);

  std::vector<std::vector<PlaneProposal>> by_block(tree.blocks().size());
  parallel_for(by_block.size(), options.num_threads, [&](std::size_t block) {
    detail::propose_planes(evaluator, block, &by_block[block]);
  });
  partition.grow(join(by_block), 0.5);
  const std::vector<std::uint8_t> everywhere(tree.leaves().size(), 1);
  for (int round = 0; round < 4 && grow_beside(evaluator, everywhere, &partition); ++round) {
  }
  const std::vector<int> grown = partition.leaf_region();
  detail::measure_shared(tree, options, partition.planes(), partition.leaf_region(), &noise);
  for (int round = 0; round < 4; ++round) {
    partition.compete();
    const bool parted = round < 3 && partition.split();
    if (parted) partition.compete();
    const bool dropped = partition.drop();
    const bool merged = partition.merge();
    if (!parted && !dropped && !merged) break;
  }
  partition.compete();
  // Competing regions leave ground between them, where one has moved off its own leaves.
  for (int round = 0; round < 4; ++round) {
    const std::vector<std::uint8_t> gaps = gaps_between(tree, grown, partition.leaf_region());
    if (!grow_beside(evaluator, gaps, &partition)) break;
    partition.compete();
    const bool dropped = partition.drop();
    const bool merged = partition.merge();
    if (dropped || merged) partition.compete();
  }
  out.leaf_region = partition.leaf_region();
  out.noise = noise.stated;
  out.typical_noise = noise.typical;
  out.shared = noise.shared;
  out.local_noise = noise.local;
  write_regions(evaluator, partition, &out);
  return out;
}

}  // namespace camber
