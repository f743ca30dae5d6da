#include "camber/export/gdal/cloud_optimized.h"

#include <cpl_conv.h>
#include <cpl_string.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <gdal_frmts.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/export/gdal/detail/gdal_dataset.h"
#include "camber/export/gdal/geotiff.h"

namespace camber {
namespace {

using detail::Complaints;
using detail::Dataset;
using detail::owned;

constexpr int kRows = 256;  // of a read; tiles are 512

Dataset opened(const std::string& path, const char* driver) {
  const std::array<const char*, 2> drivers = {driver, nullptr};
  return owned(GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, drivers.data(), nullptr,
                          nullptr));
}

Dataset copied(GDALDriverH driver, GDALDatasetH numbers, const std::string& out) {
  std::array<const char*, 6> options = {"COMPRESS=DEFLATE", "PREDICTOR=YES",
                                        "BIGTIFF=IF_SAFER", "OVERVIEW_RESAMPLING=AVERAGE",
                                        "NUM_THREADS=1",    nullptr};
  return owned(GDALCreateCopy(driver, out.c_str(), numbers, FALSE,
                              const_cast<char**>(options.data()), nullptr, nullptr));
}

/// A file's bytes in the address space; the system keeps in memory what is looked at.
class MappedFile {
 public:
  explicit MappedFile(const std::string& path) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    struct stat about {};
    if (file >= 0 && ::fstat(file, &about) == 0) size_ = static_cast<std::size_t>(about.st_size);
    if (file >= 0) bytes_ = ::mmap(nullptr, size_, PROT_READ, MAP_SHARED, file, 0);
    if (file >= 0) ::close(file);
    if (bytes_ == MAP_FAILED) throw MachineError("out of memory: no room to look at " + path);
  }
  ~MappedFile() { ::munmap(bytes_, size_); }
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  const std::uint8_t* bytes() const { return static_cast<const std::uint8_t*>(bytes_); }
  std::size_t size() const { return size_; }

 private:
  void* bytes_ = MAP_FAILED;
  std::size_t size_ = 0;
};

class Writer {
 public:
  Writer(const RawRaster& raster, const std::string& out)
      : raster_(raster), out_(out), numbers_(raster.file) {
    const std::size_t expected = raster.bands.size() * band_bytes();
    if (numbers_.size() != expected) {
      throw MachineError(
          fmt::format("{}: found {} bytes, expected {}", raster.name, numbers_.size(), expected));
    }
  }
  void write(const std::string& crs, const std::map<std::string, std::string>& metadata);

 private:
  std::size_t number_bytes() const { return raster_.bytes ? 1 : 4; }
  std::size_t band_bytes() const {
    return raster_.grid.columns * raster_.grid.rows * number_bytes();
  }
  GDALDataType type() const { return raster_.bytes ? GDT_Byte : GDT_Float32; }
  void check(bool is_done) const;
  Dataset described(const std::string& crs, const std::map<std::string, std::string>& metadata);
  bool holds(GDALDatasetH file) const;

  const RawRaster& raster_;
  const std::string& out_;
  Complaints complaints_;
  MappedFile numbers_;
};

void Writer::check(bool is_done) const {
  const std::string reason = complaints_.first();
  if (is_done && reason.empty()) return;
  throw OutputError(raster_.name, "GDAL cannot write it" + (reason.empty() ? "" : ": " + reason));
}

/// The numbers where they are, with what they are.
Dataset Writer::described(const std::string& crs,
                          const std::map<std::string, std::string>& metadata) {
  const SiteGrid& grid = raster_.grid;
  const GDALDriverH driver = GDALGetDriverByName("MEM");
  check(driver != nullptr);
  Dataset file = owned(GDALCreate(driver, "", static_cast<int>(grid.columns),
                                  static_cast<int>(grid.rows), 0, type(), nullptr));
  check(file != nullptr);
  std::array<double, 6> corners = {grid.west, grid.cell, 0.0, grid.north, 0.0, -grid.cell};
  check(GDALSetGeoTransform(file.get(), corners.data()) == CE_None);
  if (!crs.empty()) check(detail::set_system(file.get(), crs));
  for (const auto& [name, value] : metadata) {
    check(GDALSetMetadataItem(file.get(), name.c_str(), value.c_str(), nullptr) == CE_None);
  }
  for (std::size_t i = 0; i < raster_.bands.size(); ++i) {
    const auto address = reinterpret_cast<std::uintptr_t>(numbers_.bytes() + i * band_bytes());
    const std::string place = fmt::format("DATAPOINTER=0x{:x}", address);
    std::array<const char*, 2> options = {place.c_str(), nullptr};
    check(GDALAddBand(file.get(), type(), const_cast<char**>(options.data())) == CE_None);
    const GDALRasterBandH band = GDALGetRasterBand(file.get(), static_cast<int>(i) + 1);
    GDALSetDescription(band, raster_.bands[i].name.c_str());
    check(GDALSetRasterUnitType(band, raster_.bands[i].unit.c_str()) == CE_None &&
          GDALSetRasterColorInterpretation(band, raster_.bytes ? GCI_GrayIndex : GCI_Undefined) ==
              CE_None &&
          GDALSetRasterNoDataValue(band, raster_.bytes ? 0.0 : kGeoTiffNoData) == CE_None);
  }
  return file;
}

/// Whether a file has the numbers. Where libtiff has no memory for a row it goes on with another.
bool Writer::holds(GDALDatasetH file) const {
  const auto columns = static_cast<int>(raster_.grid.columns);
  const auto rows = static_cast<int>(raster_.grid.rows);
  std::vector<std::uint8_t> read(raster_.grid.columns * kRows * number_bytes());
  for (std::size_t i = 0; i < raster_.bands.size(); ++i) {
    const GDALRasterBandH band = GDALGetRasterBand(file, static_cast<int>(i) + 1);
    for (int row = 0; row < rows; row += kRows) {
      const int count = std::min(kRows, rows - row);
      const std::size_t bytes =
          static_cast<std::size_t>(count) * raster_.grid.columns * number_bytes();
      const std::uint8_t* const expected =
          numbers_.bytes() + i * band_bytes() +
          static_cast<std::size_t>(row) * raster_.grid.columns * number_bytes();
      if (GDALRasterIO(band, GF_Read, 0, row, columns, count, read.data(), columns, count, type(),
                       0, 0) != CE_None ||
          std::memcmp(read.data(), expected, bytes) != 0) {
        return false;
      }
    }
  }
  return true;
}

void Writer::write(const std::string& crs, const std::map<std::string, std::string>& metadata) {
  // What the format cannot hold is not to be put into a file beside it; nor is a cache to grow
  // with the machine.
  const CPLConfigOptionSetter no_side_file("GDAL_PAM_ENABLED", "NO", false);
  GDALSetCacheMax64(64 << 20);
  GDALRegister_MEM();
  GDALRegister_GTiff();
  GDALRegister_COG();
  const Dataset numbers = described(crs, metadata);
  const GDALDriverH driver = GDALGetDriverByName("COG");
  check(driver != nullptr);
  Dataset file = copied(driver, numbers.get(), out_);
  check(file != nullptr);
  file.reset();  // writes what is left
  check(true);
  const Dataset written = opened(out_, "GTiff");
  check(written != nullptr &&
        GDALGetRasterCount(written.get()) == static_cast<int>(raster_.bands.size()));
  check(holds(written.get()));
  if (!crs.empty() && GDALGetSpatialRef(written.get()) == nullptr) {
    throw NoAnswerError(
        fmt::format("a GeoTIFF cannot name the coordinate system '{}'", crs.substr(0, 80)));
  }
}

}  // namespace

void write_cloud_optimized(const RawRaster& raster, const std::string& crs,
                           const std::map<std::string, std::string>& metadata,
                           const std::string& out) {
  const auto most = static_cast<std::size_t>(std::numeric_limits<int>::max());
  if (raster.grid.columns > most || raster.grid.rows > most) {
    throw NoAnswerError("the raster has too many cells; larger cells give fewer");
  }
  Writer(raster, out).write(crs, metadata);
}

void copy_cloud_optimized(const std::string& raster, const std::string& name,
                          const std::string& out) {
  const Complaints complaints;
  const CPLConfigOptionSetter no_side_file("GDAL_PAM_ENABLED", "NO", false);
  GDALSetCacheMax64(64 << 20);
  GDALRegister_VRT();
  GDALRegister_GTiff();
  GDALRegister_COG();
  const auto check = [&](bool is_done) {
    const std::string reason = complaints.first();
    if (is_done && reason.empty()) return;
    throw OutputError(name, "GDAL cannot write it" + (reason.empty() ? "" : ": " + reason));
  };
  const Dataset from = opened(raster, "VRT");
  if (from == nullptr) throw InputError(raster, "GDAL cannot read it: " + complaints.first());
  const GDALDriverH driver = GDALGetDriverByName("COG");
  check(driver != nullptr);
  Dataset file = copied(driver, from.get(), out);
  check(file != nullptr);
  file.reset();  // writes what is left
  check(true);
  const Dataset written = opened(out, "GTiff");
  check(written != nullptr && GDALGetRasterCount(written.get()) == GDALGetRasterCount(from.get()));
  const int columns = GDALGetRasterXSize(from.get()), rows = GDALGetRasterYSize(from.get());
  std::vector<float> expected(static_cast<std::size_t>(columns) * kRows), found(expected.size());
  for (int band = 1; band <= GDALGetRasterCount(from.get()); ++band) {
    for (int row = 0; row < rows; row += kRows) {
      const int count = std::min(kRows, rows - row);
      for (const auto& [dataset, values] :
           {std::pair(from.get(), &expected), std::pair(written.get(), &found)}) {
        check(GDALRasterIO(GDALGetRasterBand(dataset, band), GF_Read, 0, row, columns, count,
                           values->data(), columns, count, GDT_Float32, 0, 0) == CE_None);
      }
      check(expected == found);
    }
  }
  if (GDALGetSpatialRef(from.get()) != nullptr && GDALGetSpatialRef(written.get()) == nullptr) {
    throw NoAnswerError(name + ": a GeoTIFF cannot name the coordinate system");
  }
}

std::vector<std::string> files_beside_cloud_optimized(const std::string& out) {
  return {out + ".ovr.tmp", out + ".msk.ovr.tmp", out + ".msk.tmp", out + ".aux.xml"};
}

}  // namespace camber
