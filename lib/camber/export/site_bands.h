#pragma once

#include <array>
#include <string>
#include <vector>

#include "camber/export/gdal/cloud_optimized.h"
#include "camber/export/site_raster.h"

/// A site's raster as it stands in a GeoTIFF. Needs no GDAL.
namespace camber {

inline constexpr std::size_t kSiteBands = 5;

/// Heights of ground and surface, slope (degrees), sigma of the ground's height, points.
std::vector<RasterBand> site_bands(const std::string& height_unit);

/// The numbers of these bands: slopes in degrees, kGeoTiffNoData for what is not known.
std::array<std::vector<float>, kSiteBands> site_band_values(SiteRows rows);

}  // namespace camber
