#pragma once

#include <vector>

#include "camber/cloud/plan_bounds.h"
#include "camber/road/road_surface.h"

namespace camber {

/// A polygon's part within bounds in x and y, corners interpolated along its edges (Sutherland and
/// Hodgman, CACM 1974); empty where it is outside.
std::vector<Eigen::Vector3d> cut_polygon(const std::vector<Eigen::Vector3d>& polygon,
                                         const PlanBounds& bounds);

/// Leaves of a surface, whose plan is x and y, what lies within bounds: patches without one of the
/// points there go, with their links; outlines are cut, planes stay.
/// @param labels  patch of each point within the bounds, -1: none
void cut_surface(const PlanBounds& bounds, const std::vector<int>& labels, RoadSurface* surface);

}  // namespace camber
