#include "camber/export/gdal/raster_file.h"

#include <cpl_conv.h>
#include <fmt/format.h>
#include <gdal_frmts.h>
#include <ogr_srs_api.h>

#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/export/gdal/detail/gdal_dataset.h"

namespace camber {
namespace {

using detail::Complaints;
using detail::Dataset;
using detail::owned;

[[noreturn]] void fail(const std::string& path, const Complaints& complaints, const char* found) {
  const std::string reason = complaints.first();
  throw InputError(path, found + (reason.empty() ? "" : ": GDAL: " + reason) +
                             ", expected a GeoTIFF of heights");
}

Dataset open(const std::string& path, const Complaints& complaints) {
  GDALRegister_GTiff();
  GDALSetCacheMax64(64 << 20);
  const std::array<const char*, 2> drivers = {"GTiff", nullptr};
  Dataset file = owned(GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, drivers.data(),
                                  nullptr, nullptr));
  if (!file) fail(path, complaints, "cannot be read");
  return file;
}

/// Number of the band of a name (lower case); 0: none.
int band_named(GDALDatasetH file, const std::string& name) {
  for (int i = 1; i <= GDALGetRasterCount(file); ++i) {
    if (lower_case(GDALGetDescription(GDALGetRasterBand(file, i))) == name) return i;
  }
  return 0;
}

void choose_bands(const std::string& path, GDALDatasetH file, RasterHeader* header) {
  for (const auto& [height, sigma] :
       {std::pair("ground height", "sigma of ground height"), std::pair("height", "sigma")}) {
    header->height_band = band_named(file, height);
    if (header->height_band == 0) continue;
    header->sigma_band = band_named(file, sigma);
    return;
  }
  header->height_band = 1;
  const GDALRasterBandH band = GDALGetRasterBand(file, 1);
  const GDALDataType type = GDALGetRasterDataType(band);
  const GDALColorInterp meaning = GDALGetRasterColorInterpretation(band);
  const bool picture = meaning != GCI_Undefined && meaning != GCI_GrayIndex;
  if (type == GDT_Byte || picture || GDALDataTypeIsComplex(type)) {
    throw InputError(
        path, fmt::format("band 1: found {} ({}), expected heights", GDALGetDataTypeName(type),
                          picture ? GDALGetColorInterpretationName(meaning) : "a picture"));
  }
}

void apply_mask(GDALRasterBandH band, const RasterWindow& window, std::vector<double>* values) {
  if ((GDALGetMaskFlags(band) & GMF_ALL_VALID) != 0) return;
  std::vector<unsigned char> known(values->size());
  if (GDALRasterIO(GDALGetMaskBand(band), GF_Read, window.column, window.row, window.columns,
                   window.rows, known.data(), window.columns, window.rows, GDT_Byte, 0,
                   0) != CE_None) {
    values->clear();
    return;
  }
  for (std::size_t i = 0; i < values->size(); ++i) {
    if (known[i] == 0) (*values)[i] = std::numeric_limits<double>::quiet_NaN();
  }
}

/// Empty where it cannot be read.
std::vector<double> read_band(GDALDatasetH file, int number, const RasterWindow& window) {
  const GDALRasterBandH band = GDALGetRasterBand(file, number);
  std::vector<double> out(static_cast<std::size_t>(window.columns) *
                          static_cast<std::size_t>(window.rows));
  if (GDALRasterIO(band, GF_Read, window.column, window.row, window.columns, window.rows,
                   out.data(), window.columns, window.rows, GDT_Float64, 0, 0) != CE_None) {
    return {};
  }
  apply_mask(band, window, &out);
  int has_offset = 0, has_scale = 0;
  const double offset = GDALGetRasterOffset(band, &has_offset);
  const double scale = GDALGetRasterScale(band, &has_scale);
  for (double& value : out) {
    if (has_scale != 0) value *= scale;
    if (has_offset != 0) value += offset;
    if (!std::isfinite(value)) value = std::numeric_limits<double>::quiet_NaN();
  }
  return out;
}

}  // namespace

RasterHeader read_raster_header(const std::string& path) {
  const Complaints complaints;
  const Dataset file = open(path, complaints);
  RasterHeader out;
  out.columns = GDALGetRasterXSize(file.get());
  out.rows = GDALGetRasterYSize(file.get());
  if (GDALGetRasterCount(file.get()) < 1) fail(path, complaints, "found no band");
  if (GDALGetGeoTransform(file.get(), out.place.data()) != CE_None) {
    throw InputError(path,
                     "states no place of its cells, expected a GeoTIFF with them (or a world file "
                     "beside it)");
  }
  if (!(std::abs(out.place[1] * out.place[5] - out.place[2] * out.place[4]) > 0.0)) {
    throw InputError(path, "found cells without an area, expected a GeoTIFF of heights");
  }
  choose_bands(path, file.get(), &out);
  const GDALRasterBandH band = GDALGetRasterBand(file.get(), out.height_band);
  out.band = GDALGetDescription(band);
  if (out.band.empty()) out.band = std::to_string(out.height_band);
  out.unit = GDALGetRasterUnitType(band);
  if (OGRSpatialReferenceH system = GDALGetSpatialRef(file.get())) {
    char* text = nullptr;
    if (OSRExportToWkt(system, &text) == OGRERR_NONE && text != nullptr) out.crs = text;
    CPLFree(text);
  }
  return out;
}

void read_raster(const std::string& path, const RasterHeader& header,
                 std::vector<RasterWindow>* windows) {
  const Complaints complaints;
  const Dataset file = open(path, complaints);
  for (RasterWindow& window : *windows) {
    window.values = read_band(file.get(), header.height_band, window);
    if (window.values.empty()) fail(path, complaints, "is damaged");
    if (header.sigma_band == 0) continue;
    const std::vector<double> sigmas = read_band(file.get(), header.sigma_band, window);
    if (sigmas.empty()) fail(path, complaints, "is damaged");
    window.sigmas.assign(sigmas.begin(), sigmas.end());
  }
}

}  // namespace camber
