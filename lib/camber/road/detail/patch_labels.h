#pragma once

#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/road/ground_tree.h"
#include "camber/road/patch_segmentation.h"

namespace camber::detail {

/// Which region each point belongs to: one of its leaf's or the neighbouring leaves' whose plane it
/// lies on, by the regions' own noise; of several the one on whose side of the crease it is, or the
/// nearest.
struct PatchLabels {
  std::vector<int> rows;   ///< region of every row of the tree, -1: none
  std::vector<int> cloud;  ///< region of every point of the cloud, -1: none
};

/// @param whole  the tree holds all points of the cloud
/// The same for any number of threads.
PatchLabels label_patches(const RoadCloud& cloud, bool whole, const GroundTree& tree,
                          const Segmentation& segmentation, int num_threads);

}  // namespace camber::detail
