#include "gdal_functions.h"

#include "camber/core/errors.h"
#include "plugins/plugin.h"

namespace camber::tools {

const GdalFunctions& gdal_functions() {
  if (!has_plugin("gdal")) {
    throw MachineError(
        "GeoTIFF and files of lines are read and written by Debian's package libgdal-dev, which "
        "was not there when this program was built: install it and build the program anew");
  }
  using Functions = const GdalFunctions* (*)();
  return *reinterpret_cast<Functions>(plugin_symbol("gdal", "camber_gdal"))();
}

}  // namespace camber::tools
