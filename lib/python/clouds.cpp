#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <type_traits>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/stream_filters.h"
#include "convert.h"
#include "running.h"

namespace camber::python {
namespace {

const char* name_of(CloudFrame frame) {
  switch (frame) {
    case CloudFrame::kCamera:
      return "camera";
    case CloudFrame::kZUp:
      return "z-up";
    default:
      return "unknown";
  }
}

CloudFrame frame_of(const std::string& name) {
  for (const CloudFrame frame : {CloudFrame::kUnknown, CloudFrame::kCamera, CloudFrame::kZUp}) {
    if (name == name_of(frame)) return frame;
  }
  throw std::invalid_argument("frame: found '" + name +
                              "', expected 'camera', 'z-up' or 'unknown'");
}

/// Rows of `Columns` numbers, one for each point of the cloud, into an attribute's array; into the
/// same memory where there is one already.
template <typename Scalar, std::size_t Columns, typename Row>
void take_rows(const py::handle& value, std::size_t points, const char* name,
               std::vector<Row>* out) {
  using Array = py::array_t<Scalar, py::array::c_style | py::array::forcecast>;
  static_assert(sizeof(Row) == Columns * sizeof(Scalar));
  const py::array given = py::array::ensure(value);
  if constexpr (std::is_integral_v<Scalar>) {
    const char kind = given ? given.dtype().kind() : '?';
    const bool whole = kind == 'u' || (sizeof(Scalar) > 1 && (kind == 'i' || kind == 'b'));
    if (!whole || (sizeof(Scalar) == 1 && given.itemsize() != 1)) {
      PyErr_Clear();
      throw std::invalid_argument(
          fmt::format("{}: expected {}", name, sizeof(Scalar) == 1 ? "uint8" : "whole numbers"));
    }
    // numpy would take the remainder of what does not fit.
    using Limits = std::numeric_limits<Scalar>;
    if (given.size() > 0 && given.itemsize() >= static_cast<py::ssize_t>(sizeof(Scalar))) {
      const py::int_ least(given.attr("min")()), most(given.attr("max")());
      const auto text = [](const py::object& number) { return std::string(py::str(number)); };
      if (least < py::int_(Limits::min()) || most > py::int_(Limits::max())) {
        throw std::invalid_argument(
            fmt::format("{}: found numbers from {} to {}, expected {} to {}", name, text(least),
                        text(most), Limits::min(), Limits::max()));
      }
    }
  }
  const Array rows = given ? Array::ensure(given) : Array();
  const bool flat = rows && Columns == 1 && rows.ndim() == 1;
  const bool fits =
      rows && (flat || (rows.ndim() == 2 && rows.shape(1) == static_cast<py::ssize_t>(Columns)));
  if (!fits || static_cast<std::size_t>(rows.shape(0)) != points) {
    PyErr_Clear();
    throw std::invalid_argument(
        Columns == 1 ? fmt::format("{}: expected {} numbers, one for each point", name, points)
                     : fmt::format("{}: expected {} x {} numbers, a row for each point", name,
                                   points, Columns));
  }
  out->resize(points);
  if (points > 0) {
    std::memcpy(static_cast<void*>(out->data()), rows.data(), points * sizeof(Row));
  }
}

/// A label or scalar, new or in the memory of the one that is there.
template <typename T>
void take_named(const std::string& name, const py::handle& value, std::size_t points,
                std::map<std::string, std::vector<T>>* all) {
  const auto found = all->find(name);
  if (found != all->end()) return take_rows<T, 1>(value, points, name.c_str(), &found->second);
  std::vector<T> taken;
  take_rows<T, 1>(value, points, name.c_str(), &taken);
  all->emplace(name, std::move(taken));
}

RoadCloud make_cloud(const py::object& points, const py::object& colors, const py::object& sigmas,
                     const py::object& covariances, const py::object& normals,
                     const py::dict& labels, const py::dict& scalars, const std::string& frame,
                     bool metric) {
  RoadCloud out = cloud_from_points(points, "points");
  const std::size_t count = out.size();
  out.frame = frame_of(frame);
  out.metric = metric;
  if (!colors.is_none()) take_rows<std::uint8_t, 3>(colors, count, "colors", &out.colors);
  if (!sigmas.is_none()) take_rows<float, 1>(sigmas, count, "sigmas", &out.sigmas);
  if (!covariances.is_none()) {
    take_rows<float, 6>(covariances, count, "covariances", &out.covariances);
  }
  if (!normals.is_none()) take_rows<float, 3>(normals, count, "normals", &out.normals);
  for (const auto& [key, value] : labels) {
    take_named(py::str(key), value, count, &out.labels);
  }
  for (const auto& [key, value] : scalars) {
    take_named(py::str(key), value, count, &out.scalars);
  }
  return out;
}

std::string describe(const RoadCloud& cloud) {
  std::string with;
  const auto add = [&](const std::string& name) { with += (with.empty() ? "" : ", ") + name; };
  if (!cloud.colors.empty()) add("colors");
  if (!cloud.sigmas.empty()) add("sigmas");
  if (!cloud.covariances.empty()) add("covariances");
  if (!cloud.normals.empty()) add("normals");
  for (const auto& entry : cloud.labels) add(entry.first);
  for (const auto& entry : cloud.scalars) add(entry.first);
  return fmt::format("<camber.RoadCloud {} points{}{}, frame {}{}>", cloud.size(),
                     with.empty() ? "" : " with ", with, name_of(cloud.frame),
                     cloud.metric ? "" : ", up to scale");
}

RoadCloud select(const RoadCloud& cloud, const py::object& indices) {
  const py::array given = py::array::ensure(indices);
  PyErr_Clear();
  const char kind = given ? given.dtype().kind() : '?';
  const bool nothing = given && given.size() == 0;
  const bool mask = kind == 'b';
  if (!given || given.ndim() != 1 || !(nothing || mask || kind == 'i' || kind == 'u') ||
      (mask && static_cast<std::size_t>(given.size()) != cloud.size())) {
    throw std::invalid_argument(
        fmt::format("indices: expected whole numbers, or a mask of {} bools", cloud.size()));
  }
  if (nothing) return cloud.select({});
  using Indices = py::array_t<std::int64_t, py::array::forcecast>;
  const Indices numbers(mask ? py::object(py::tuple(given.attr("nonzero")())[0])
                             : py::object(given));
  std::vector<int> chosen;
  for (py::ssize_t i = 0; i < numbers.size(); ++i) {
    const std::int64_t index = numbers.at(i);
    if (index < 0 || static_cast<std::uint64_t>(index) >= cloud.size()) {
      throw std::invalid_argument(
          fmt::format("point index {}, expected one in [0, {})", index, cloud.size()));
    }
    chosen.push_back(static_cast<int>(index));
  }
  return cloud.select(chosen);
}

/// An attribute's array as numpy sees it, and one of equal length written into it.
#define CAMBER_ROWS(name, Scalar, columns)                                                       \
  def_property(                                                                                  \
      #name, [](const py::object& self) { return view_of(self.cast<RoadCloud&>().name, self); }, \
      [](RoadCloud& cloud, const py::object& value) {                                            \
        take_rows<Scalar, columns>(value, cloud.size(), #name, &cloud.name);                     \
      },                                                                                         \
      CAMBER_DOC(RoadCloud, name))

template <typename T>
py::dict views_of(std::map<std::string, std::vector<T>>& values, const py::object& owner) {
  py::dict out;
  for (auto& [name, list] : values) out[py::str(name)] = view_of(list, owner);
  return out;
}

py::array_t<double> true_points(const RoadCloud& cloud) {
  py::array_t<double> out({static_cast<py::ssize_t>(cloud.size()), py::ssize_t{3}});
  auto rows = out.mutable_unchecked<2>();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (py::ssize_t axis = 0; axis < 3; ++axis) {
      rows(static_cast<py::ssize_t>(i), axis) =
          cloud.origin[axis] + static_cast<double>(cloud.points[i][axis]);
    }
  }
  return out;
}

void bind_coordinate_systems(py::module_& module) {
  py::class_<CoordinateUnit>(module, "CoordinateUnit", kDoc_CoordinateUnit)
      .CAMBER_FIELD(CoordinateUnit, name)
      .CAMBER_FIELD(CoordinateUnit, metres)
      .CAMBER_FIELD(CoordinateUnit, angle)
      .CAMBER_FIELD(CoordinateUnit, epsg);
  py::class_<CoordinateSystem>(module, "CoordinateSystem", kDoc_CoordinateSystem)
      .def_property_readonly(
          "kind", [](const CoordinateSystem& crs) { return to_string(crs.kind); },
          "'unknown', 'projected', 'geographic', 'geocentric' or 'local'")
      .CAMBER_FIELD(CoordinateSystem, name)
      .CAMBER_FIELD(CoordinateSystem, epsg)
      .CAMBER_FIELD(CoordinateSystem, vertical_epsg)
      .CAMBER_FIELD(CoordinateSystem, horizontal)
      .CAMBER_FIELD(CoordinateSystem, vertical)
      .CAMBER_FIELD(CoordinateSystem, wkt)
      .def_property_readonly("metric", &CoordinateSystem::metric, kDoc_CoordinateSystem_metric)
      .def("__repr__", [](const CoordinateSystem& crs) {
        return "<camber.CoordinateSystem " + camber::describe(crs) + ">";
      });
}

}  // namespace

void bind_clouds(py::module_& module) {
  bind_coordinate_systems(module);
  py::class_<RoadCloud>(
      module, "RoadCloud",
      (std::string(kDoc_RoadCloud) +
       "\n\nThe arrays are views: what is written to them is in the cloud. An attribute that the "
       "cloud does not have is an empty array.")
          .c_str())
      .def(py::init(&make_cloud), py::arg("points"), py::kw_only(), py::arg("colors") = py::none(),
           py::arg("sigmas") = py::none(), py::arg("covariances") = py::none(),
           py::arg("normals") = py::none(), py::arg("labels") = py::dict(),
           py::arg("scalars") = py::dict(), py::arg("frame") = "unknown", py::arg("metric") = true,
           "A cloud of N x 3 points (copied); of float64 the round part becomes the origin.")
      .def("__len__", &RoadCloud::size)
      .def_property_readonly(
          "frame", [](const RoadCloud& c) { return name_of(c.frame); },
          "'camera', 'z-up' or 'unknown'")
      .def_readwrite("metric", &RoadCloud::metric, CAMBER_DOC(RoadCloud, metric))
      .def_readwrite("origin", &RoadCloud::origin, "m; true coordinates are origin + points")
      .CAMBER_ROWS(points, float, 3)
      .CAMBER_ROWS(colors, std::uint8_t, 3)
      .CAMBER_ROWS(sigmas, float, 1)
      .CAMBER_ROWS(covariances, float, 6)
      .CAMBER_ROWS(normals, float, 3)
      .def_property_readonly(
          "labels",
          [](const py::object& self) { return views_of(self.cast<RoadCloud&>().labels, self); },
          CAMBER_DOC(RoadCloud, labels))
      .def_property_readonly(
          "scalars",
          [](const py::object& self) { return views_of(self.cast<RoadCloud&>().scalars, self); },
          CAMBER_DOC(RoadCloud, scalars))
      .def(
          "set_label",
          [](RoadCloud& cloud, const std::string& name, const py::object& values) {
            take_named(name, values, cloud.size(), &cloud.labels);
          },
          py::arg("name"), py::arg("values"), "Adds or overwrites a label.")
      .def(
          "set_scalar",
          [](RoadCloud& cloud, const std::string& name, const py::object& values) {
            take_named(name, values, cloud.size(), &cloud.scalars);
          },
          py::arg("name"), py::arg("values"), "Adds or overwrites a scalar.")
      .def("true_points", &true_points, "origin + points in double, N x 3: a new array")
      .def("select", &select, py::arg("indices"),
           (std::string(kDoc_RoadCloud_select) +
            " A mask of bools, one for each point, selects those that are True.")
               .c_str())
      .def_property_readonly("default_up", &RoadCloud::default_up, kDoc_RoadCloud_default_up)
      .def("__repr__", &describe);

  module.def(
      "read_cloud",
      [](const std::filesystem::path& path, bool lenient, std::optional<std::size_t> scan,
         bool own_frame, const std::optional<std::vector<double>>& bounds) {
        return compute([&] {
          ReadOptions options;
          options.lenient = lenient;
          options.scan = scan;
          options.own_frame = own_frame;
          if (bounds) {
            if (bounds->size() != 4) {
              throw std::invalid_argument("bounds: found " + std::to_string(bounds->size()) +
                                          " numbers, expected x0, y0, x1, y1");
            }
            options.bounds = PlanBounds{(*bounds)[0], (*bounds)[1], (*bounds)[2], (*bounds)[3]};
          }
          return read_cloud(path, options);
        });
      },
      py::arg("path"), py::kw_only(), py::arg("lenient") = false, py::arg("scan") = py::none(),
      py::arg("own_frame") = false, py::arg("bounds") = py::none(),
      with_keywords(kDoc_read_cloud_file,
                    {{"lenient", kDoc_ReadOptions_lenient},
                     {"scan", kDoc_ReadOptions_scan},
                     {"own_frame", kDoc_ReadOptions_own_frame},
                     {"bounds",
                      "x0, y0, x1, y1: points outside are left out; half-open, in the "
                      "file's coordinates and units."}})
          .c_str());
  module.def(
      "read_coordinate_system",
      [](const std::filesystem::path& path) {
        return compute([&] { return open_point_source(path)->header().crs; });
      },
      py::arg("path"), "The coordinate system that a cloud file states, or None.");
  module.def(
      "write_cloud",
      [](const RoadCloud& cloud, const std::filesystem::path& path,
         const std::optional<CoordinateSystem>& crs) {
        compute([&] {
          if (!crs) return write_cloud(cloud, path);
          write_points(*with_crs(make_point_source(cloud), crs), path);
        });
      },
      py::arg("cloud"), py::arg("path"), py::kw_only(), py::arg("crs") = py::none(),
      with_keywords(kDoc_write_cloud, {{"crs", "The coordinate system to state."}}).c_str());
}

}  // namespace camber::python
