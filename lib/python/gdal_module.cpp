// camber._gdal: what GDAL does for the module camber. Apart, so that it is loaded by those alone
// who ask for it.

#include <map>
#include <string>

#include "camber/core/errors.h"
#include "camber/export/gdal/geotiff.h"
#include "convert.h"

namespace {

namespace py = pybind11;
using camber::RoadRaster;
using Band = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Colors = py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>;

std::vector<float> values(const Band& band) { return {band.data(), band.data() + band.size()}; }

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
  try {
    return py::bytes(camber::encode_geotiff(raster, crs, metadata));
  } catch (const camber::Error& error) {
    const bool no_answer = error.exit_code() == camber::NoAnswerError("").exit_code();
    const py::object made =
        py::module_::import("camber").attr(no_answer ? "NoAnswerError" : "MachineError");
    const py::object instance = made(error.what());
    instance.attr("exit_code") = error.exit_code();
    PyErr_SetObject(made.ptr(), instance.ptr());
    throw py::error_already_set();
  }
}

}  // namespace

PYBIND11_MODULE(_gdal, module) {
  module.doc() = "GeoTIFF, for camber.export().";
  module.def("encode_geotiff", &encode);
}
