#pragma once

#include "plugins/gdal_plugin.h"

namespace camber::tools {

/// What GDAL does for the program, loaded when it is asked for. @throws MachineError where the
/// program was built without GDAL.
const GdalFunctions& gdal_functions();

}  // namespace camber::tools
