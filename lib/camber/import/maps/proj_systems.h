#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/cloud/coordinate_system.h"

/// Coordinate systems by name, by PROJ. MachineError where PROJ has no memory or no database.
namespace camber {

/// The system with a definition (EPSG:n, a PROJ string, well-known text, a name).
/// @return false and a reason where there is none
bool find_coordinate_system(const std::string& definition, CoordinateSystem* found,
                            std::string* reason);

/// Longitudes and latitudes (degrees, WGS 84) to coordinates of a system in the order east, north,
/// or, if `inverse`, back. @return false and a reason where it cannot
bool project_places(const std::string& definition, bool inverse,
                    std::vector<Eigen::Vector2d>* places, std::string* reason);

/// A system as a PROJ string. @return false where it has none
bool find_proj_string(const std::string& definition, std::string* text);

/// Coordinates of one system to those of another, both in the order east, north, heights left out.
/// @return false and a reason where PROJ knows no way, a rough one only, or one that needs a grid
///         that is not installed
bool transform_places(const std::string& from, const std::string& to,
                      std::vector<Eigen::Vector2d>* places, std::string* reason);

}  // namespace camber
