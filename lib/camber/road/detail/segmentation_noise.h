#pragma once

#include <vector>

#include "camber/plane/plane_solver.h"
#include "camber/road/ground_tree.h"
#include "camber/road/patch_segmentation.h"

namespace camber::detail {

/// What the points of a tree are weighed by while it is cut into planar regions.
struct SegmentationNoise {
  NoiseModel stated;       ///< as given or learnt, without the ground's roughness
  NoiseModel noise;        ///< with it
  double typical = 0.0;    ///< m; 0 where it depends on the plane (NoiseKind::kRays)
  double tolerance = 0.0;  ///< of a leaf's mean from its plane, standard deviations of a point
  double shared = 0.0;     ///< as in Segmentation
  double local = 0.0;      ///< as in Segmentation
};

/// Learns what the start leaves open from neighbourhoods of the tree's points, and weighs these for
/// a level plane (but for NoiseKind::kRays, whose weights depend on the plane).
SegmentationNoise learn_segmentation_noise(const SegmentationOptions& options, NoiseModel start,
                                           GroundTree* tree);

/// How much less points scatter about the ground of their own leaf than they are stated to, by the
/// planes of the regions: sets `shared` where the noise is stated and not known to be complete.
/// @param leaf_region  index of a plane for each leaf, or -1
void measure_shared(const GroundTree& tree, const SegmentationOptions& options,
                    const std::vector<PivotPlane>& planes, const std::vector<int>& leaf_region,
                    SegmentationNoise* noise);

}  // namespace camber::detail
