#pragma once

#include "camber/road/road_surface.h"

namespace camber {

/// What joins neighbouring patches in the optimisation.
enum class Consistency {
  kNone,        ///< patches stay as they were fitted
  kPaper,       ///< the paper's equation 8: normals and offsets of neighbours are alike
  kContinuity,  ///< neighbours have the same height where they meet
};

struct ConsistencyOptions {
  Consistency consistency = Consistency::kContinuity;
  double link_distance = 6.0;  ///< m, patches farther apart are no neighbours, > 0; paper: 5 to 7
  double max_angle = 0.35;     ///< rad between neighbours' normals, more is a wall, (0, pi / 2)
  double max_step = 0.05;      ///< m, a step above it (and chance) is a kerb, > 0
  double continuity_sigma = 0.03;  ///< m, how well heights agree where patches meet, > 0
  double normal_sigma = 0.05;      ///< rad, kPaper: how alike neighbouring normals are, > 0
  double offset_sigma = 0.2;       ///< m, kPaper: how alike offsets at the midpoint's foot are, > 0
  void validate() const;           ///< throws std::invalid_argument naming field, value and bound
};

/// Neighbourhood of all patches of a surface. A link that the patches contradict (kerb, wall,
/// overpass) is kept, marked invalid, with the reason.
/// `height_step` is measured at the middle of the shortest way between the two boundaries, and
/// `weight` falls from 1 for touching patches to exp(-2) at link_distance.
std::vector<PatchLink> find_links(const RoadSurface& surface, const ConsistencyOptions& options);

struct ConsistencyReport {
  double initial_cost = 0.0, final_cost = 0.0;
  int residuals = 0;
  bool converged = false;
};

/// Moves all planes together: each is held by its own covariance, neighbours over valid links by
/// their consistency. Planes, covariances, grades, banks, boundaries and the links' steps and
/// angles are updated. Solved with Ceres (Levenberg-Marquardt; a Cauchy loss on the links).
ConsistencyReport optimise_surface(const ConsistencyOptions& options, RoadSurface* surface);

/// Sets axis1, axis2, grade and bank of every patch: axis1 along the road, ahead, where the driven
/// line or the neighbours give it, else along the patch's longer side.
void align_patches_with_road(RoadSurface* surface);

}  // namespace camber
