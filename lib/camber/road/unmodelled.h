#pragma once

#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/road/road_surface.h"

namespace camber {

/// Sets each patch's unmodelled_sigma: what the ground leaves its plane by, seen as the excess of
/// the mean residuals of cells of 3 m over what the scatter within them explains, and errors that
/// neighbouring points may have in common, a share of the patch's noise: they bend or lift a patch
/// and are seen nowhere in it. Clouds without a scale get the share of the noise alone.
/// @param labels  patch id of each point of the cloud, -1: none
/// Large clouds are represented by about 262,144 points in their order.
void measure_unmodelled(const RoadCloud& cloud, const std::vector<int>& labels,
                        RoadSurface* surface);

}  // namespace camber
