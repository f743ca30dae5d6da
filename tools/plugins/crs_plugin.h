#pragma once

#include <string>

namespace camber {
struct CoordinateSystem;
}

namespace camber::tools {

/// What the plugin crs exports as camber_find_crs: the system with a definition (EPSG:n, a PROJ
/// string, well-known text, a name); false and a reason where there is none.
using FindCrs = bool (*)(const char* definition, CoordinateSystem* found, std::string* reason);

}  // namespace camber::tools
