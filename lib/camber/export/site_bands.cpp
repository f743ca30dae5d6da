#include "camber/export/site_bands.h"

#include <cmath>

#include "camber/export/gdal/geotiff.h"

namespace camber {

std::vector<RasterBand> site_bands(const std::string& height_unit) {
  return {{"ground height", height_unit},
          {"surface height", height_unit},
          {"slope", "degree"},
          {"sigma of ground height", height_unit},
          {"points", ""}};
}

std::array<std::vector<float>, kSiteBands> site_band_values(SiteRows rows) {
  constexpr double kDegrees = 180.0 / 3.14159265358979323846;
  for (float& slope : rows.slopes) slope *= static_cast<float>(kDegrees);
  std::array<std::vector<float>, kSiteBands> out = {std::move(rows.ground), std::move(rows.surface),
                                                    std::move(rows.slopes), std::move(rows.sigmas),
                                                    std::move(rows.points)};
  for (std::vector<float>& band : out) {
    for (float& value : band) {
      if (std::isnan(value)) value = static_cast<float>(kGeoTiffNoData);
    }
  }
  return out;
}

}  // namespace camber
