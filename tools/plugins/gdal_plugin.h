#pragma once

#include <map>
#include <string>

#include "camber/export/gdal/cloud_optimized.h"
#include "camber/export/gdal/line_file.h"
#include "camber/export/road_raster.h"

namespace camber::tools {

/// What the plugin gdal exports, camber_gdal(): --to geotiff of export, lines of --along.
/// All of them work in a process of their own, so that they can be refused where GDAL breaks down.
struct GdalFunctions {
  std::string (*encode_geotiff)(const RoadRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata);
  VectorLines (*read_lines)(const std::string& path);
  void (*write_cloud_optimized)(const RawRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata,
                                const std::string& out);
};

}  // namespace camber::tools
