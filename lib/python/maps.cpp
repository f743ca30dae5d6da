#include "maps.h"

#include <fmt/format.h>

#include <stdexcept>
#include <vector>

#include "camber/import/map_projection.h"
#include "camber/import/maps/proj_systems.h"

namespace camber::python {

std::string map_definition(const std::string& definition, const std::string& what) {
  CoordinateSystem system;
  std::string reason;
  if (!system_of_definition(definition, find_coordinate_system, &system, &reason)) {
    throw std::invalid_argument(
        fmt::format("{}: found '{}', expected EPSG:n, well-known text or a PROJ string: {}", what,
                    definition.substr(0, 80), reason));
  }
  complete_system(&system, find_coordinate_system);
  if (system.kind != CoordinateSystem::Kind::kProjected || !system.metric()) {
    throw std::invalid_argument(
        fmt::format("{}: found '{}' ({}), expected a projected system in metres", what,
                    definition.substr(0, 80), describe(system)));
  }
  return system.epsg != 0 ? fmt::format("EPSG:{}", system.epsg) : system.wkt;
}

MapProjection map_projection(const std::string& what) {
  return [what](const std::string& crs, const std::vector<GeoPoint>& points) {
    return map_places(crs, points, what, project_places);
  };
}

}  // namespace camber::python
