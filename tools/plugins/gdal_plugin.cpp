// GeoTIFF by GDAL, which brings many shared libraries.

#include "gdal_plugin.h"

#include "camber/export/gdal/geotiff.h"
#include "plugin.h"

namespace {

const camber::tools::GdalFunctions kFunctions{camber::encode_geotiff};

}  // namespace

CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal();
CAMBER_EXPORT const camber::tools::GdalFunctions* camber_gdal() { return &kFunctions; }
