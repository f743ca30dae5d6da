#pragma once

#include <map>
#include <string>
#include <vector>

#include "camber/export/site_raster.h"

namespace camber {

/// One band of a raster file.
struct RasterBand {
  std::string name, unit;
};

/// A file of numbers in the machine's order, band by band, row by row, as they are to stand in a
/// Cloud Optimized GeoTIFF.
struct RawRaster {
  std::string file;
  SiteGrid grid;
  std::vector<RasterBand> bands;
  std::string name;    ///< of the output, for messages
  bool bytes = false;  ///< numbers of 8 bits, 0: not known; else floats of 32, kGeoTiffNoData
};

/// Writes a Cloud Optimized GeoTIFF (tiles, overviews by means; without loss) with GDAL's driver,
/// block by block, and reads it back against the numbers.
/// @param crs  EPSG:n (compound systems EPSG:n+m), well-known text or a PROJ string; empty: none
/// @throws NoAnswerError for a coordinate system that GDAL does not know or the format has no keys
///         for; OutputError where the file cannot be written, MachineError where GDAL has no
///         memory.
void write_cloud_optimized(const RawRaster& raster, const std::string& crs,
                           const std::map<std::string, std::string>& metadata,
                           const std::string& out);

/// The same of a raster that GDAL opens by its virtual format (VRT), with what that states.
/// @param raster  path of the file
/// @param name    of the output, for messages
/// @throws InputError where the raster, or a file of it, cannot be read; else as
///         write_cloud_optimized()
void copy_cloud_optimized(const std::string& raster, const std::string& name,
                          const std::string& out);

/// Files that GDAL may leave beside `out` where it breaks down.
std::vector<std::string> files_beside_cloud_optimized(const std::string& out);

}  // namespace camber
