// camber._gdal: what GDAL does for the module camber. Apart, so that it is loaded by those alone
// who ask for it.

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/export/gdal/cloud_optimized.h"
#include "camber/export/gdal/geotiff.h"
#include "convert.h"

namespace {

namespace py = pybind11;
using camber::RoadRaster;
using Band = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Colors = py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>;

std::vector<float> values(const Band& band) { return {band.data(), band.data() + band.size()}; }

/// As the class of the module camber that errors.cpp has for it.
[[noreturn]] void raise(const camber::Error& error) {
  const bool no_answer = dynamic_cast<const camber::NoAnswerError*>(&error) != nullptr;
  const bool input = dynamic_cast<const camber::InputError*>(&error) != nullptr;
  const bool output = dynamic_cast<const camber::OutputError*>(&error) != nullptr;
  const char* const name = no_answer ? "NoAnswerError"
                           : input   ? "InputError"
                           : output  ? "OutputError"
                                     : "MachineError";
  const py::object made = py::module_::import("camber").attr(name);
  const py::object instance = made(error.what());
  instance.attr("exit_code") = error.exit_code();
  PyErr_SetObject(made.ptr(), instance.ptr());
  throw py::error_already_set();
}

/// What a task gives while the interpreter's lock is released.
template <typename Task>
auto without_lock(const Task& task) {
  try {
    const py::gil_scoped_release released;
    return task();
  } catch (const camber::Error& error) {
    raise(error);
  }
}

py::bytes encode(const Band& heights, const Band& sigmas, const Band& slopes,
                 const std::optional<Colors>& colors, double west, double north, double cell,
                 const std::string& crs, const std::map<std::string, std::string>& metadata) {
  RoadRaster raster;
  raster.rows = static_cast<std::size_t>(heights.shape(0));
  raster.columns = static_cast<std::size_t>(heights.shape(1));
  raster.west = west;
  raster.north = north;
  raster.cell = cell;
  raster.heights = values(heights);
  raster.sigmas = values(sigmas);
  raster.slopes = values(slopes);
  if (colors) {
    for (const std::uint8_t* at = colors->data(); at != colors->data() + colors->size(); at += 4) {
      raster.colors.emplace_back();
      if (at[3] != 0) raster.colors.back() = {at[0], at[1], at[2]};
    }
  }
  return py::bytes(without_lock([&] { return camber::encode_geotiff(raster, crs, metadata); }));
}

/// A task that writes a GeoTIFF; what it leaves where it breaks down is removed.
template <typename Task>
void write_file(const std::string& out, const Task& task) {
  try {
    without_lock(task);
  } catch (...) {
    for (const std::string& file : camber::files_beside_cloud_optimized(out)) {
      std::error_code error;
      std::filesystem::remove(file, error);
    }
    throw;
  }
}

/// @param bands  names with units
/// @param place  west, north and cell
/// @param size   columns and rows
void write_cloud_optimized(const std::string& file,
                           const std::vector<std::pair<std::string, std::string>>& bands,
                           const std::array<double, 3>& place,
                           const std::array<std::size_t, 2>& size, const std::string& name,
                           const std::string& crs,
                           const std::map<std::string, std::string>& metadata,
                           const std::string& out) {
  camber::RawRaster raster;
  raster.file = file;
  raster.name = name;
  for (const auto& [band, unit] : bands) raster.bands.push_back({band, unit});
  raster.grid.west = place[0];
  raster.grid.north = place[1];
  raster.grid.cell = place[2];
  raster.grid.columns = size[0];
  raster.grid.rows = size[1];
  write_file(out, [&] { camber::write_cloud_optimized(raster, crs, metadata, out); });
}

void copy_cloud_optimized(const std::string& raster, const std::string& name,
                          const std::string& out) {
  write_file(out, [&] { camber::copy_cloud_optimized(raster, name, out); });
}

}  // namespace

PYBIND11_MODULE(_gdal, module) {
  module.doc() = "GeoTIFF, for camber.export() and the rasters of tiles.";
  module.def("encode_geotiff", &encode);
  module.def("write_cloud_optimized", &write_cloud_optimized);
  module.def("copy_cloud_optimized", &copy_cloud_optimized);
}
