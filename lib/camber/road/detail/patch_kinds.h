#pragma once

#include <map>
#include <utility>

#include "camber/road/consistency_graph.h"
#include "camber/road/road_surface.h"

namespace camber::detail {

/// Pairs of leaves of two patches that touch, by the patches' ids, the smaller first.
using PatchBorders = std::map<std::pair<int, int>, int>;

/// Which patches are road: those that hang together smoothly with the one under the driven line,
/// for a camera's cloud without one with what lies ahead of the camera, else with the largest one.
/// Patches a kerb's height beside them are pavement.
/// @param borders  how many pairs of leaves of two patches touch, by id
/// @param surface  its links are complete; the kinds of its patches are set
void classify_patches(const ConsistencyOptions& options, const PatchBorders& borders,
                      RoadSurface* surface);

/// Calls road and pavements ground.
void name_ground(RoadSurface* surface);

}  // namespace camber::detail
