#pragma once

#include <optional>
#include <string>

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/point_selection.h"

namespace camber::tools {

/// The area of --polygon: polygons of a GeoJSON file, or the points of any cloud format as one
/// ring; in the coordinates of the cloud, whose system is `cloud`.
/// @throws InputError for what is no polygon, and for longitudes and latitudes of a cloud in a
///         projected system.
PlanRings read_plan_area(const std::string& path, const std::optional<CoordinateSystem>& cloud);

}  // namespace camber::tools
