// Coordinate systems by name: what calls PROJ.

#include "crs_plugin.h"

#include "camber/import/maps/proj_systems.h"
#include "plugin.h"

CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason);
CAMBER_EXPORT bool camber_find_crs(const char* definition, camber::CoordinateSystem* found,
                                   std::string* reason) {
  return camber::find_coordinate_system(definition, found, reason);
}

CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason);
CAMBER_EXPORT bool camber_project(const char* definition, bool inverse,
                                  std::vector<Eigen::Vector2d>* places, std::string* reason) {
  return camber::project_places(definition, inverse, places, reason);
}

CAMBER_EXPORT bool camber_proj_string(const char* definition, std::string* text);
CAMBER_EXPORT bool camber_proj_string(const char* definition, std::string* text) {
  return camber::find_proj_string(definition, text);
}

CAMBER_EXPORT bool camber_transform(const char* from, const char* to,
                                    std::vector<Eigen::Vector2d>* places, std::string* reason);
CAMBER_EXPORT bool camber_transform(const char* from, const char* to,
                                    std::vector<Eigen::Vector2d>* places, std::string* reason) {
  return camber::transform_places(from, to, places, reason);
}
