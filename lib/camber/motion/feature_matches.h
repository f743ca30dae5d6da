#pragma once

#include <cstddef>
#include <vector>

#include "camber/image/image.h"
#include "camber/motion/correspondences.h"

namespace camber {

struct FeatureMatchOptions {
  int max_features = 2000;  ///< of each image, the strongest, >= 8
  double ratio = 0.8;       ///< of the nearest descriptor's distance to the second's, < 1
  int num_threads = 0;      ///< <= 0: see resolve_num_threads
  void validate() const;    ///< throws std::invalid_argument
};

/// Sparse correspondences from a reference image to all others, of any displacement:
/// scale-invariant features whose descriptors are mutually nearest, and plainly nearer than the
/// second nearest (Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 2004).
/// For motions that a dense flow loses. The result has one row, with one column a feature of the
/// reference image that at least one image shows. Exhaustive, so that it is the same in any run.
/// @throws std::invalid_argument for images that differ in size or are empty, or no such reference.
Correspondences match_features(const std::vector<GrayImage>& images, int reference,
                               const FeatureMatchOptions& options);

}  // namespace camber
