#include "camber/export/gdal/geotiff.h"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal.h>
#include <gdal_frmts.h>
#include <ogr_srs_api.h>

#include <array>
#include <atomic>
#include <cmath>
#include <memory>
#include <vector>

#include "camber/core/errors.h"

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

/// Keeps GDAL from printing.
class Quiet {
 public:
  Quiet() {
    CPLErrorReset();
    CPLPushErrorHandler(CPLQuietErrorHandler);
  }
  ~Quiet() { CPLPopErrorHandler(); }
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;
};

struct Band {
  const char* name;
  const char* unit;
  GDALColorInterp meaning;
  std::vector<float> values;
};

std::vector<float> known(std::vector<float> values, double factor) {
  for (float& value : values) {
    value = static_cast<float>(std::isfinite(value) ? factor * double{value} : kGeoTiffNoData);
  }
  return values;
}

std::vector<Band> bands_of(const RoadRaster& raster) {
  std::vector<Band> bands;
  bands.push_back({"height", "m", GCI_Undefined, known(raster.heights, 1.0)});
  bands.push_back({"sigma", "m", GCI_Undefined, known(raster.sigmas, 1.0)});
  bands.push_back({"slope", "degree", GCI_Undefined, known(raster.slopes, kDegrees)});
  if (raster.colors.empty()) return bands;
  const std::array<const char*, 3> names = {"red", "green", "blue"};
  const std::array<GDALColorInterp, 3> meanings = {GCI_RedBand, GCI_GreenBand, GCI_BlueBand};
  for (std::size_t k = 0; k < 3; ++k) {
    Band band{names[k], "", meanings[k], {}};
    for (const auto& color : raster.colors) {
      band.values.push_back(color ? static_cast<float>((*color)[k])
                                  : static_cast<float>(kGeoTiffNoData));
    }
    bands.push_back(std::move(band));
  }
  return bands;
}

[[noreturn]] void refuse() {
  throw MachineError(fmt::format("GDAL cannot write the GeoTIFF: {}", CPLGetLastErrorMsg()));
}

void set_system(GDALDatasetH file, const std::string& crs) {
  const std::unique_ptr<void, void (*)(OGRSpatialReferenceH)> system(
      OSRNewSpatialReference(nullptr), OSRDestroySpatialReference);
  if (OSRSetFromUserInput(system.get(), crs.c_str()) != OGRERR_NONE) {
    throw NoAnswerError(
        fmt::format("GDAL does not know the coordinate system '{}'", crs.substr(0, 80)));
  }
  OSRSetAxisMappingStrategy(system.get(), OAMS_TRADITIONAL_GIS_ORDER);
  if (GDALSetSpatialRef(file, system.get()) != CE_None) refuse();
}

void write_band(GDALDatasetH file, int number, Band& band, int columns, int rows) {
  const GDALRasterBandH out = GDALGetRasterBand(file, number);
  GDALSetDescription(out, band.name);
  GDALSetRasterUnitType(out, band.unit);
  GDALSetRasterColorInterpretation(out, band.meaning);
  GDALSetRasterNoDataValue(out, kGeoTiffNoData);
  if (GDALRasterIO(out, GF_Write, 0, 0, columns, rows, band.values.data(), columns, rows,
                   GDT_Float32, 0, 0) != CE_None) {
    refuse();
  }
}

/// A file in memory, removed with it.
class MemoryFile {
 public:
  MemoryFile() {
    static std::atomic<unsigned> count{0};
    name_ = fmt::format("/vsimem/camber_{}.tif", count++);
  }
  ~MemoryFile() { VSIUnlink(name_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  const char* name() const { return name_.c_str(); }
  std::string bytes() const {
    vsi_l_offset size = 0;
    const GByte* data = VSIGetMemFileBuffer(name(), &size, FALSE);
    if (data == nullptr) refuse();
    return {reinterpret_cast<const char*>(data), static_cast<std::size_t>(size)};
  }

 private:
  std::string name_;
};

}  // namespace

std::string encode_geotiff(const RoadRaster& raster, const std::string& crs,
                           const std::map<std::string, std::string>& metadata) {
  const Quiet quiet;
  GDALRegister_GTiff();
  const GDALDriverH driver = GDALGetDriverByName("GTiff");
  if (driver == nullptr) refuse();
  std::vector<Band> bands = bands_of(raster);
  const MemoryFile memory;
  std::array<const char*, 5> options = {"COMPRESS=DEFLATE", "PREDICTOR=3", "TILED=YES",
                                        "BIGTIFF=IF_SAFER", nullptr};
  const int columns = static_cast<int>(raster.columns), rows = static_cast<int>(raster.rows);
  std::unique_ptr<void, void (*)(GDALDatasetH)> file(
      GDALCreate(driver, memory.name(), columns, rows, static_cast<int>(bands.size()), GDT_Float32,
                 const_cast<char**>(options.data())),
      [](GDALDatasetH open) {
        if (open != nullptr) GDALClose(open);
      });
  if (file == nullptr) refuse();
  std::array<double, 6> corners = {raster.west, raster.cell, 0.0, raster.north, 0.0, -raster.cell};
  if (GDALSetGeoTransform(file.get(), corners.data()) != CE_None) refuse();
  if (!crs.empty()) set_system(file.get(), crs);
  for (const auto& [name, value] : metadata) {
    GDALSetMetadataItem(file.get(), name.c_str(), value.c_str(), nullptr);
  }
  for (std::size_t i = 0; i < bands.size(); ++i) {
    write_band(file.get(), static_cast<int>(i) + 1, bands[i], columns, rows);
  }
  CPLErrorReset();
  file.reset();  // writes what is left
  if (CPLGetLastErrorType() >= CE_Failure) refuse();
  return memory.bytes();
}

}  // namespace camber
