#pragma once

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/road_cloud.h"

namespace camber {

/// Takes a cloud whose coordinates are in other units of length to metres: x and y by the
/// horizontal unit, z by the vertical one; sigmas, covariances and normals with them (a sigma by
/// the horizontal unit). The cloud is metric then. Does nothing where all axes are in metres.
/// @throws std::invalid_argument for angles.
void to_metres(RoadCloud* cloud, const CoordinateSystem& system);

}  // namespace camber
