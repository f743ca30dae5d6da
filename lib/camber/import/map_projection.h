#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "camber/import/import_own.h"

namespace camber {

/// project_places() of maps/proj_systems.h, or what calls it.
using ProjectPlaces =
    std::function<bool(const std::string& crs, bool inverse, std::vector<Eigen::Vector2d>* places,
                       std::string* reason)>;

/// A MapProjection: points on the map of a coordinate system, with the direction of true north.
/// @param name  of the option that named the system, for messages
/// @throws UsageError for a system on which they have no place, or whose lengths are more than 2 %
///         from those on the ground
std::vector<MapPlace> map_places(const std::string& crs, const std::vector<GeoPoint>& points,
                                 const std::string& name, const ProjectPlaces& project);

}  // namespace camber
