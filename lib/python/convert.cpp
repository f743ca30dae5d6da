#include "convert.h"

#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"

namespace camber::python {
namespace {

std::string shape_of(const py::array& array) {
  std::string out = py::str(array.dtype());
  for (py::ssize_t i = 0; i < array.ndim(); ++i) {
    out += (i == 0 ? " of " : " x ") + std::to_string(array.shape(i));
  }
  return out;
}

/// Numbers with three columns, in rows without gaps. @throws std::invalid_argument.
template <typename T>
py::array_t<T, py::array::c_style | py::array::forcecast> three_columns(const py::array& array,
                                                                        const std::string& what) {
  const char kind = array.dtype().kind();
  if (array.ndim() != 2 || array.shape(1) != 3 || (kind != 'f' && kind != 'i' && kind != 'u')) {
    throw std::invalid_argument(what + ": found " + shape_of(array) +
                                ", expected numbers of N x 3");
  }
  return array;
}

}  // namespace

py::array view_of(Image& image, py::handle owner) {
  std::vector<py::ssize_t> shape{image.height, image.width};
  if (image.channels > 1) shape.push_back(image.channels);
  return view(image.data.data(), shape, owner);
}

Image to_image(const py::handle& value, const std::string& what) {
  if (!py::isinstance<py::array>(value)) {
    throw std::invalid_argument(what + ": found " +
                                std::string(py::str(py::type::of(value).attr("__name__"))) +
                                ", expected a numpy array");
  }
  const auto array = py::reinterpret_borrow<py::array>(value);
  const bool bytes = array.dtype().kind() == 'u' && array.itemsize() == 1;
  if (!bytes || array.ndim() < 2 || array.ndim() > 3 || array.size() == 0) {
    throw std::invalid_argument(what + ": found " + shape_of(array) +
                                ", expected uint8 of height x width (x channels)");
  }
  const py::array_t<std::uint8_t, py::array::c_style> rows(array);
  Image out;
  out.height = static_cast<int>(array.shape(0));
  out.width = static_cast<int>(array.shape(1));
  out.channels = array.ndim() == 3 ? static_cast<int>(array.shape(2)) : 1;
  out.data.assign(rows.data(), rows.data() + rows.size());
  return out;
}

RoadCloud cloud_from_points(const py::handle& value, const char* name) {
  const py::array array = py::array::ensure(value);
  if (!array) {
    PyErr_Clear();
    throw std::invalid_argument(std::string(name) + ": expected a RoadCloud or numbers of N x 3");
  }
  RoadCloud out;
  if (array.dtype().kind() == 'f' && array.itemsize() == 4) {
    const auto rows = three_columns<float>(array, name);
    out.points.resize(static_cast<std::size_t>(rows.shape(0)));
    if (!out.points.empty()) {
      std::memcpy(out.points[0].data(), rows.data(), 12 * out.points.size());
    }
    return out;
  }
  const auto rows = three_columns<double>(array, name);
  const auto count = static_cast<std::size_t>(rows.shape(0));
  if (count == 0) return out;
  PointStreamHeader header;
  header.count = count;
  PointBatch batch;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    PointField field;
    field.name = std::string(1, "xyz"[axis]);
    field.type = ScalarType::kFloat64;
    header.fields.push_back(field);
    batch.fields.push_back({reinterpret_cast<const unsigned char*>(rows.data() + axis), 24});
  }
  CloudBuilder builder(header, false);
  for (std::size_t start = 0; start < count; start += kBatchSize) {
    PointBatch part = batch;
    part.count = std::min(kBatchSize, count - start);
    for (FieldView& field : part.fields) field.data += 24 * start;
    builder.add(part);
  }
  ReadReport report;
  return builder.finish(report);
}

CloudArgument::CloudArgument(const py::object& value, const char* name) {
  if (py::isinstance<RoadCloud>(value)) {
    cloud = value.cast<const RoadCloud*>();
  } else {
    made = cloud_from_points(value, name);
    cloud = &made;
  }
}

std::vector<Eigen::Vector3d> to_points(const py::handle& value, const std::string& what) {
  const py::array array = py::array::ensure(value);
  if (!array) {
    PyErr_Clear();
    throw std::invalid_argument(what + ": expected numbers of N x 3");
  }
  if (array.size() == 0) return {};
  const auto rows = three_columns<double>(array, what);
  std::vector<Eigen::Vector3d> out(static_cast<std::size_t>(rows.shape(0)));
  std::memcpy(out[0].data(), rows.data(), 24 * out.size());
  return out;
}

py::object gdal_function(const char* name) {
  try {
    return py::module_::import("camber._gdal").attr(name);
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ImportError)) throw;
    throw MachineError("the module was built without GDAL (Debian's libgdal-dev): " +
                       std::string(error.what()));
  }
}

py::object to_python(const nlohmann::json& json) {
  switch (json.type()) {
    case nlohmann::json::value_t::object: {
      py::dict out;
      for (const auto& [key, value] : json.items()) out[py::str(key)] = to_python(value);
      return out;
    }
    case nlohmann::json::value_t::array: {
      py::list out;
      for (const auto& value : json) out.append(to_python(value));
      return out;
    }
    case nlohmann::json::value_t::string:
      return py::str(json.get_ref<const std::string&>());
    case nlohmann::json::value_t::boolean:
      return py::bool_(json.get<bool>());
    case nlohmann::json::value_t::number_integer:
      return py::int_(json.get<std::int64_t>());
    case nlohmann::json::value_t::number_unsigned:
      return py::int_(json.get<std::uint64_t>());
    case nlohmann::json::value_t::number_float:
      return py::float_(json.get<double>());
    default:
      return py::none();
  }
}

std::string with_keywords(const char* doc,
                          const std::vector<std::pair<const char*, const char*>>& keywords) {
  std::string out = doc;
  out += "\n\nKeywords:\n";
  for (const auto& [name, meaning] : keywords) {
    out += std::string("  ") + name + ": " + meaning + "\n";
  }
  return out;
}

}  // namespace camber::python
