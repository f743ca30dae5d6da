#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace camber {
struct CoordinateSystem;
}

namespace camber::tools {

/// What the plugin crs exports as camber_find_crs: the system with a definition (EPSG:n, a PROJ
/// string, well-known text, a name); false and a reason where there is none.
using FindCrs = bool (*)(const char* definition, CoordinateSystem* found, std::string* reason);

/// What it exports as camber_project: longitudes and latitudes (degrees, WGS 84) to coordinates of
/// a system in the order east, north, or, if `inverse`, back; false and a reason where it cannot.
using Project = bool (*)(const char* definition, bool inverse, std::vector<Eigen::Vector2d>* places,
                         std::string* reason);

/// What it exports as camber_transform: coordinates of one system to those of another, both in the
/// order east, north, heights left out; false and a reason where PROJ knows no way, a rough one
/// only, or one that needs a grid that is not installed.
using Transform = bool (*)(const char* from, const char* to, std::vector<Eigen::Vector2d>* places,
                           std::string* reason);

/// What it exports as camber_proj_string: a system as a PROJ string; false where it has none.
using ProjString = bool (*)(const char* definition, std::string* text);

}  // namespace camber::tools
