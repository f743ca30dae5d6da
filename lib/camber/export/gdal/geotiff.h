#pragma once

#include <map>
#include <string>

#include "camber/export/road_raster.h"

namespace camber {

/// The value of cells that are not seen, in every band.
inline constexpr double kGeoTiffNoData = -9999.0;

/// A GeoTIFF of 4-byte floats, compressed without loss, of bands named height (m), sigma (m), slope
/// (degrees) and, where the raster has colours, red, green and blue (0 to 255).
/// @param crs       EPSG:n, well-known text or a PROJ string; empty: none is known
/// @param metadata  of the whole file: name and value
/// @return          the file's bytes
/// @throws NoAnswerError for a coordinate system that GDAL does not know or the format has no keys
///         for; MachineError where GDAL cannot write.
std::string encode_geotiff(const RoadRaster& raster, const std::string& crs,
                           const std::map<std::string, std::string>& metadata);

}  // namespace camber
