#pragma once

#include <map>
#include <string>

#include "camber/export/gdal/line_file.h"
#include "camber/export/road_raster.h"

namespace camber::tools {

/// What the plugin gdal exports, camber_gdal(): --to geotiff of export, lines of --along.
struct GdalFunctions {
  std::string (*encode_geotiff)(const RoadRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata);
  VectorLines (*read_lines)(const std::string& path);
};

}  // namespace camber::tools
