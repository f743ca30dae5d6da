#pragma once

#include <map>
#include <string>

#include "camber/export/road_raster.h"

namespace camber::tools {

/// What the plugin gdal exports, camber_gdal(): --to geotiff of export.
struct GdalFunctions {
  std::string (*encode_geotiff)(const RoadRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata);
};

}  // namespace camber::tools
