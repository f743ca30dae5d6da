#pragma once

#include <map>
#include <string>
#include <vector>

#include "camber/export/gdal/cloud_optimized.h"
#include "camber/export/gdal/line_file.h"
#include "camber/export/gdal/raster_file.h"
#include "camber/export/road_raster.h"

namespace camber::tools {

/// What the plugin gdal exports, camber_gdal(): --to geotiff of export, lines of --along, heights
/// of a GeoTIFF. All of them work in a process of their own, so that they can be refused where GDAL
/// breaks down.
struct GdalFunctions {
  std::string (*encode_geotiff)(const RoadRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata);
  VectorLines (*read_lines)(const std::string& path);
  void (*write_cloud_optimized)(const RawRaster& raster, const std::string& crs,
                                const std::map<std::string, std::string>& metadata,
                                const std::string& out);
  void (*copy_cloud_optimized)(const std::string& raster, const std::string& name,
                               const std::string& out);
  RasterHeader (*read_raster_header)(const std::string& path);
  void (*read_raster)(const std::string& path, const RasterHeader& header,
                      std::vector<RasterWindow>* windows);
};

}  // namespace camber::tools
