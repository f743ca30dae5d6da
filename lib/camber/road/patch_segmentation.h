#pragma once

#include <cstdint>
#include <vector>

#include "camber/plane/plane_covariance.h"
#include "camber/road/ground_tree.h"

namespace camber {

struct SegmentationOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;
  double max_slope = 0.6;         ///< rad from level
  double inlier_threshold = 0.0;  ///< m; 0: from the noise
  /// How far the road may leave a patch's plane before the patch ends, in standard deviations of a
  /// point, and at least this many metres (0 for clouds without a scale).
  double tolerance_sigmas = 0.7;
  double tolerance = 0.015;
  double roughness = 0.01;      ///< m, of ground: points lie on no plane more tightly
  int min_points = 60;          ///< of a patch
  bool noise_is_known = false;  ///< the noise given is complete and not learnt again
  double shared = 0.0;          ///< as in Segmentation, if the noise is known
};

/// A planar piece of ground in the tree's level frame.
struct PlanarRegion {
  PlaneCandidate candidate;  ///< plane, window, noise
  PlaneEstimate estimate;
  std::vector<int> leaves;  ///< ascending
  double points = 0.0;      ///< inliers in its leaves
};

struct Segmentation {
  std::vector<PlanarRegion> regions;
  std::vector<int> leaf_region;  ///< index of a region, or -1
  NoiseModel noise;  ///< of the whole cloud, before the regions' own and without roughness
  double typical_noise = 0.0;  ///< m
  /// m, of the points about their neighbourhoods' planes, where a threshold was given; 0: not
  /// known.
  double local_noise = 0.0;
  /// Share of the points' stated deviations that neighbours have in common, for they scatter less
  /// among themselves: 0 for independent errors, 1 at most.
  double shared = 0.0;
};

/// Finds the planar pieces of a road. The number of planes is not given.
///
/// Every block of a few hundred points proposes planes (MSAC). The proposals grow over neighbouring
/// leaves as long as a leaf's points lie on the plane, being refitted on the way; then the regions
/// compete for leaves by cost, with a preference for the neighbours' region (iterated conditional
/// modes: Besag, JRSS B 1986), are refitted, merged where one plane does for two, and dropped where
/// others explain their leaves as well (the label cost of PEARL: Isack and Boykov, IJCV 2012).
Segmentation segment_planes(GroundTree& tree, NoiseModel start, const SegmentationOptions& options);

}  // namespace camber
