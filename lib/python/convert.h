#pragma once

// Between numpy's arrays and the library's containers.

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/plane.h"
#include "camber/geometry/se3.h"
#include "camber/image/image.h"
#include "camber/road/consistency_graph.h"
#include "docstrings.h"

#define CAMBER_DOC(type, name) kDoc_##type##_##name
/// A read-only attribute with the comment of the C++ field.
#define CAMBER_FIELD(type, name) def_readonly(#name, &type::name, CAMBER_DOC(type, name))

namespace camber::python {

namespace py = pybind11;

/// rows x columns of T that belong to `owner`: no copy. Writing to it writes to the owner.
template <typename T>
py::array view(T* data, std::vector<py::ssize_t> shape, py::handle owner) {
  static T nothing{};
  return py::array(py::dtype::of<T>(), std::move(shape), data ? data : &nothing, owner);
}

template <typename T>
py::array view_of(std::vector<T>& values, py::handle owner) {
  return view(values.data(), {static_cast<py::ssize_t>(values.size())}, owner);
}

/// Vectors and arrays of a fixed length as rows of a matrix.
template <typename Scalar, int Rows>
py::array view_of(std::vector<Eigen::Matrix<Scalar, Rows, 1>>& values, py::handle owner) {
  return view(values.empty() ? nullptr : values[0].data(),
              {static_cast<py::ssize_t>(values.size()), Rows}, owner);
}

template <typename T, std::size_t Columns>
py::array view_of(std::vector<std::array<T, Columns>>& values, py::handle owner) {
  return view(values.empty() ? nullptr : values[0].data(),
              {static_cast<py::ssize_t>(values.size()), static_cast<py::ssize_t>(Columns)}, owner);
}

/// height x width, or height x width x channels; no copy.
py::array view_of(Image& image, py::handle owner);

/// An array of unsigned bytes, height x width or height x width x channels, as an image (a copy).
/// @throws std::invalid_argument that names `what`.
Image to_image(const py::handle& array, const std::string& what);

/// A RoadCloud, or the cloud of an N x 3 array of numbers. Arrays of 8-byte numbers keep their
/// digits: the cloud gets an origin.
struct CloudArgument {
  explicit CloudArgument(const py::object& value, const char* name);
  RoadCloud made;
  const RoadCloud* cloud = nullptr;
};
RoadCloud cloud_from_points(const py::handle& array, const char* name);

/// Rows of N x 3 numbers in double. @throws std::invalid_argument that names `what`.
std::vector<Eigen::Vector3d> to_points(const py::handle& array, const std::string& what);

py::object to_python(const nlohmann::json& json);

/// A function of camber._gdal: GDAL, which brings a hundred libraries, is in a module of its own,
/// which is loaded here. @throws MachineError where the module was built without it
py::object gdal_function(const char* name);

/// "continuity", "paper" or "none". @throws std::invalid_argument
Consistency consistency_of(const std::string& name);

/// 4 x 4, row by row.
inline Eigen::Matrix4d to_matrix(const SE3& pose) { return pose.matrix(); }

/// The docstring of a function and what its keywords mean.
std::string with_keywords(const char* doc,
                          const std::vector<std::pair<const char*, const char*>>& keywords);

void bind_errors(py::module_& module);
void bind_geometry(py::module_& module);
void bind_clouds(py::module_& module);
void bind_roads(py::module_& module);
void bind_scenes(py::module_& module);
void bind_vehicles(py::module_& module);
void bind_reconstruction(py::module_& module);
void bind_comparison(py::module_& module);
void bind_importing(py::module_& module);
void bind_results(py::module_& module);
void bind_cloud_work(py::module_& module);
void bind_drives(py::module_& module);
void bind_tiles(py::module_& module);

}  // namespace camber::python
