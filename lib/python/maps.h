#pragma once

#include <string>

#include "camber/import/import_own.h"

namespace camber::python {

/// The map that a definition (EPSG:n, well-known text, a PROJ string) names, as PROJ reads it.
/// @param what  name of the parameter, for messages
/// @throws std::invalid_argument for what is no projected system in metres
std::string map_definition(const std::string& definition, const std::string& what);

/// By PROJ. @param what  as above
MapProjection map_projection(const std::string& what);

}  // namespace camber::python
