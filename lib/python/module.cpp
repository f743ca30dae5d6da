// The Python module camber: what camber/_core.so defines and camber/__init__.py hands on.

#include "camber/core/version.h"
#include "convert.h"

PYBIND11_MODULE(_core, module) {
  namespace python = camber::python;
  module.doc() = "Metric road surfaces and vehicles from one moving camera.";
  module.attr("__version__") = camber::kVersion;
  // Classes and signatures name the package, not this part of it.
  const pybind11::object name = module.attr("__name__");
  module.attr("__name__") = "camber";
  python::bind_errors(module);
  python::bind_geometry(module);
  python::bind_clouds(module);
  python::bind_roads(module);
  python::bind_scenes(module);
  python::bind_vehicles(module);
  python::bind_reconstruction(module);
  python::bind_comparison(module);
  python::bind_importing(module);
  python::bind_results(module);
  python::bind_cloud_work(module);
  python::bind_drives(module);
  python::bind_tiles(module);
  module.attr("__name__") = name;
}
