#pragma once

#include "camber/road/fit_road_surface.h"

namespace camber {

struct RegionGrowingOptions {
  int normal_neighbours = 50;   ///< nearest points that a normal is estimated from, >= 3
  int neighbours = 30;          ///< nearest points that a region may grow to, >= 1
  double max_angle = 0.052;     ///< rad between a point's normal and the region's first, > 0
  double max_curvature = 0.05;  ///< of a point from which a region grows on, > 0
  void validate() const;        ///< throws std::invalid_argument naming field, value and bound
};

/// The same question as fit_road_surface() put to the Point Cloud Library, to check one against the
/// other: normals of nearest neighbours, regions grown over smooth neighbours (Rabbani, van den
/// Heuvel, Vosselman, "Segmentation of point clouds using smoothness constraint", ISPRS 2006), a
/// least-squares plane for each. Of `options` up, max_slope, min_patch_points, driven_line and
/// consistency (links; planes are not moved) are used; points count alike, and a plane's covariance
/// is that of its least squares. How far a region leaves its plane is bound by the normals alone.
/// @throws std::invalid_argument as fit_road_surface(). Deterministic; one thread.
RoadSurfaceFit fit_road_surface_pcl(const RoadCloud& cloud, const RoadSurfaceOptions& options,
                                    const RegionGrowingOptions& growing = {});

}  // namespace camber
