#include "camber/export/gdal/geotiff.h"

#include <cpl_conv.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal_frmts.h>

#include <array>
#include <atomic>
#include <cmath>
#include <vector>

#include "camber/core/errors.h"
#include "camber/export/gdal/detail/gdal_dataset.h"

namespace camber {
namespace {

using detail::Complaints;
using detail::Dataset;
using detail::owned;
using detail::set_system;

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

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

bool transfer(GDALRasterBandH band, GDALRWFlag direction, std::vector<float>& values) {
  const int columns = GDALGetRasterBandXSize(band), rows = GDALGetRasterBandYSize(band);
  return GDALRasterIO(band, direction, 0, 0, columns, rows, values.data(), columns, rows,
                      GDT_Float32, 0, 0) == CE_None;
}

bool write_band(GDALDatasetH file, int number, Band& band) {
  const GDALRasterBandH out = GDALGetRasterBand(file, number);
  GDALSetDescription(out, band.name);
  return GDALSetRasterUnitType(out, band.unit) == CE_None &&
         GDALSetRasterColorInterpretation(out, band.meaning) == CE_None &&
         GDALSetRasterNoDataValue(out, kGeoTiffNoData) == CE_None &&
         transfer(out, GF_Write, band.values);
}

Dataset reopened(const char* name) {
  const std::array<const char*, 2> drivers = {"GTiff", nullptr};
  return owned(
      GDALOpenEx(name, GDAL_OF_RASTER | GDAL_OF_READONLY, drivers.data(), nullptr, nullptr));
}

/// Whether a file holds the values. Where libtiff has no memory for a row it goes on with another.
bool holds(GDALDatasetH file, const std::vector<Band>& bands) {
  if (file == nullptr || GDALGetRasterCount(file) != static_cast<int>(bands.size())) return false;
  for (std::size_t i = 0; i < bands.size(); ++i) {
    std::vector<float> values(bands[i].values.size());
    const GDALRasterBandH band = GDALGetRasterBand(file, static_cast<int>(i) + 1);
    if (!transfer(band, GF_Read, values) || values != bands[i].values) return false;
  }
  return true;
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
    if (data == nullptr) return {};
    return {reinterpret_cast<const char*>(data), static_cast<std::size_t>(size)};
  }

 private:
  std::string name_;
};

}  // namespace

std::string encode_geotiff(const RoadRaster& raster, const std::string& crs,
                           const std::map<std::string, std::string>& metadata) {
  const Complaints complaints;
  // What the format cannot hold is not to be put into a file beside it, which nobody gets.
  const CPLConfigOptionSetter no_side_file("GDAL_PAM_ENABLED", "NO", false);
  GDALRegister_GTiff();
  const GDALDriverH driver = GDALGetDriverByName("GTiff");
  complaints.check(driver != nullptr);
  std::vector<Band> bands = bands_of(raster);
  const MemoryFile memory;
  std::array<const char*, 5> options = {"COMPRESS=DEFLATE", "PREDICTOR=3", "TILED=YES",
                                        "BIGTIFF=IF_SAFER", nullptr};
  const int columns = static_cast<int>(raster.columns), rows = static_cast<int>(raster.rows);
  Dataset file =
      owned(GDALCreate(driver, memory.name(), columns, rows, static_cast<int>(bands.size()),
                       GDT_Float32, const_cast<char**>(options.data())));
  complaints.check(file != nullptr);
  std::array<double, 6> corners = {raster.west, raster.cell, 0.0, raster.north, 0.0, -raster.cell};
  complaints.check(GDALSetGeoTransform(file.get(), corners.data()) == CE_None);
  if (!crs.empty()) complaints.check(set_system(file.get(), crs));
  for (const auto& [name, value] : metadata) {
    complaints.check(GDALSetMetadataItem(file.get(), name.c_str(), value.c_str(), nullptr) ==
                     CE_None);
  }
  for (std::size_t i = 0; i < bands.size(); ++i) {
    complaints.check(write_band(file.get(), static_cast<int>(i) + 1, bands[i]));
  }
  file.reset();  // writes what is left
  {
    const Dataset written = reopened(memory.name());
    complaints.check(holds(written.get(), bands));
    const bool named = crs.empty() || GDALGetSpatialRef(written.get()) != nullptr;
    complaints.check(true);
    if (!named) {  // it has keys for the common projections alone
      throw NoAnswerError(
          fmt::format("a GeoTIFF cannot name the coordinate system '{}'", crs.substr(0, 80)));
    }
  }
  std::string bytes = memory.bytes();
  complaints.check(!bytes.empty());
  return bytes;
}

}  // namespace camber
