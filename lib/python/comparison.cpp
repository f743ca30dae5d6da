#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/evaluate/compare.h"
#include "convert.h"
#include "running.h"

namespace camber::python {
namespace {

Alignment alignment_of(const std::string& name) {
  for (const Alignment alignment :
       {Alignment::kNone, Alignment::kScale, Alignment::kRigid, Alignment::kSimilarity}) {
    if (name == to_string(alignment)) return alignment;
  }
  throw std::invalid_argument("align: found '" + name +
                              "', expected 'none', 'scale', 'rigid' or 'similarity'");
}

/// A cloud, or a mesh where triangles are given.
Shape shape_of(const py::object& cloud, const py::object& triangles, const char* name) {
  Shape out;
  CloudArgument argument(cloud, name);
  out.cloud = argument.cloud == &argument.made ? std::move(argument.made) : *argument.cloud;
  if (triangles.is_none()) return out;
  const std::string what = std::string(name) + "_triangles";
  const py::array given = py::array::ensure(triangles);
  const char kind = given ? given.dtype().kind() : '?';
  if ((kind != 'i' && kind != 'u') || given.ndim() != 2 || given.shape(1) != 3) {
    PyErr_Clear();
    throw std::invalid_argument(what + ": expected whole numbers of N x 3");
  }
  const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast> rows(given);
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    std::array<std::uint32_t, 3> corners;
    for (py::ssize_t k = 0; k < 3; ++k) {
      const std::int64_t index = rows.at(i, k);
      if (index < 0 || static_cast<std::size_t>(index) >= out.cloud.size()) {
        throw std::invalid_argument(
            fmt::format("{}: found the point {} in row {}, expected 0 to {}", what, index, i,
                        out.cloud.size() - 1));
      }
      corners[static_cast<std::size_t>(k)] = static_cast<std::uint32_t>(index);
    }
    out.triangles.push_back(corners);
  }
  return out;
}

void bind_parts(py::module_& module) {
  py::class_<DistanceSummary>(module, "DistanceSummary", kDoc_DistanceSummary)
      .CAMBER_FIELD(DistanceSummary, count)
      .CAMBER_FIELD(DistanceSummary, mean)
      .CAMBER_FIELD(DistanceSummary, median)
      .CAMBER_FIELD(DistanceSummary, rms)
      .CAMBER_FIELD(DistanceSummary, quantile_90)
      .CAMBER_FIELD(DistanceSummary, quantile_95)
      .CAMBER_FIELD(DistanceSummary, largest)
      .def("__repr__", [](const DistanceSummary& d) {
        return fmt::format("<camber.DistanceSummary of {}: median {:.4f} m, rms {:.4f} m>", d.count,
                           d.median, d.rms);
      });
  using Directed = DirectedDistances;
  py::class_<Directed>(module, "DirectedDistances", kDoc_DirectedDistances)
      .CAMBER_FIELD(DirectedDistances, points)
      .def_property_readonly(
          "distance",
          [](const py::object& self) {
            return view_of(self.cast<Directed&>().distances.distance, self);
          },
          CAMBER_DOC(ShapeDistances, distance))
      .def_property_readonly(
          "nearest",
          [](const py::object& self) {
            return view_of(self.cast<Directed&>().distances.nearest, self);
          },
          CAMBER_DOC(ShapeDistances, nearest))
      .def_property_readonly(
          "along_normal",
          [](const py::object& self) {
            return view_of(self.cast<Directed&>().distances.along_normal, self);
          },
          CAMBER_DOC(ShapeDistances, along_normal))
      .def_property_readonly(
          "counted",
          [](const py::object& self) { return view_of(self.cast<Directed&>().counted, self); },
          CAMBER_DOC(DirectedDistances, counted))
      .def_readonly("not_finite", &Directed::not_finite)
      .def_readonly("outside", &Directed::outside)
      .def_readonly("unobserved", &Directed::unobserved)
      .def_readonly("summary", &Directed::summary, "of the counted ones")
      .def_readonly("summary_along_normal", &Directed::along_normal, "of the counted ones")
      .def("__repr__", [](const Directed& d) {
        return fmt::format("<camber.DirectedDistances of {} points, median {:.4f} m>",
                           d.summary.count, d.summary.median);
      });
  py::class_<ThresholdScore>(module, "ThresholdScore", "Scores within a distance.")
      .CAMBER_FIELD(ThresholdScore, threshold)
      .CAMBER_FIELD(ThresholdScore, precision)
      .CAMBER_FIELD(ThresholdScore, recall)
      .CAMBER_FIELD(ThresholdScore, f_score)
      .def("__repr__", [](const ThresholdScore& s) {
        return fmt::format(
            "<camber.ThresholdScore {} m: precision {:.3f}, recall {:.3f}, F {:.3f}>", s.threshold,
            s.precision, s.recall, s.f_score);
      });
  py::class_<RoadErrors>(module, "RoadErrors", kDoc_RoadErrors)
      .CAMBER_FIELD(RoadErrors, by)
      .def_readonly("start", &RoadErrors::from, "m, or degrees")
      .def_readonly("end", &RoadErrors::to, "m, or degrees")
      .CAMBER_FIELD(RoadErrors, count)
      .CAMBER_FIELD(RoadErrors, height_mean)
      .CAMBER_FIELD(RoadErrors, height_median)
      .CAMBER_FIELD(RoadErrors, height_rms)
      .CAMBER_FIELD(RoadErrors, along_rms)
      .CAMBER_FIELD(RoadErrors, across_rms)
      .def("__repr__", [](const RoadErrors& e) {
        return fmt::format("<camber.RoadErrors by {}: {} points, height {:+.4f} m, rms {:.4f} m>",
                           e.by, e.count, e.height_mean, e.height_rms);
      });
  py::class_<HeightErrorMap>(module, "HeightErrorMap", kDoc_HeightErrorMap)
      .CAMBER_FIELD(HeightErrorMap, cell)
      .def_readonly("u", &HeightErrorMap::u, "m, lower corner of the first cell")
      .def_readonly("v", &HeightErrorMap::v, "m, lower corner of the first cell")
      .def_property_readonly(
          "error",
          [](const py::object& self) {
            auto& map = self.cast<HeightErrorMap&>();
            return view(map.error.data(), {map.height, map.width}, self);
          },
          CAMBER_DOC(HeightErrorMap, error))
      .def_property_readonly(
          "count",
          [](const py::object& self) {
            auto& map = self.cast<HeightErrorMap&>();
            return view(map.count.data(), {map.height, map.width}, self);
          },
          "points in each cell");
  py::class_<AlignmentResult>(module, "AlignmentResult", "What the estimate was moved by.")
      .def_property_readonly(
          "alignment", [](const AlignmentResult& a) { return to_string(a.alignment); },
          "'none', 'scale', 'rigid' or 'similarity'")
      .CAMBER_FIELD(AlignmentResult, transform)
      .CAMBER_FIELD(AlignmentResult, scale)
      .CAMBER_FIELD(AlignmentResult, residual_before)
      .CAMBER_FIELD(AlignmentResult, residual_after)
      .CAMBER_FIELD(AlignmentResult, pairs)
      .CAMBER_FIELD(AlignmentResult, iterations);
}

}  // namespace

void bind_comparison(py::module_& module) {
  bind_parts(module);
  py::class_<CloudComparison>(module, "CloudComparison", "An estimate measured against the truth.")
      .CAMBER_FIELD(CloudComparison, metric)
      .CAMBER_FIELD(CloudComparison, accuracy)
      .CAMBER_FIELD(CloudComparison, completeness)
      .CAMBER_FIELD(CloudComparison, scores)
      .CAMBER_FIELD(CloudComparison, road)
      .def_readonly("map", &CloudComparison::map, kDoc_HeightErrorMap)
      .CAMBER_FIELD(CloudComparison, alignment)
      .def(
          "to_dict", [](const CloudComparison& c) { return to_python(to_json(c)); },
          "As camber compare --json prints it.")
      .def("__str__", [](const CloudComparison& c) { return describe(c); })
      .def("__repr__", [](const CloudComparison& c) {
        return fmt::format(
            "<camber.CloudComparison accuracy {:.4f}{unit}, completeness {:.4f}{unit} (medians{})>",
            c.accuracy.summary.median, c.completeness.summary.median,
            c.metric ? "" : ", up to scale", fmt::arg("unit", c.metric ? " m" : ""));
      });
  const CompareOptions defaults;
  module.def(
      "compare",
      [](const py::object& estimate, const py::object& truth, const py::object& estimate_triangles,
         const py::object& truth_triangles, const std::vector<double>& thresholds,
         const std::string& align, const std::optional<Eigen::Matrix4d>& estimate_from_truth,
         const std::optional<Eigen::Vector3d>& up, const std::optional<Eigen::Vector3d>& along,
         const std::optional<Eigen::Vector3d>& viewpoint,
         const std::optional<Eigen::Vector3d>& truth_viewpoint, bool road_frame, double map_cell,
         double mesh_density, std::uint64_t seed, int threads) {
        const Shape from = shape_of(estimate, estimate_triangles, "estimate");
        const Shape to = shape_of(truth, truth_triangles, "truth");
        CompareOptions options;
        options.thresholds = thresholds;
        options.alignment = alignment_of(align);
        if (estimate_from_truth) options.estimate_from_truth = *estimate_from_truth;
        options.up = up.value_or(from.cloud.default_up());
        // As camber compare has them.
        const bool camera_frame = from.cloud.frame == CloudFrame::kCamera;
        if (camera_frame) options.along = Eigen::Vector3d::UnitZ();
        if (along) options.along = *along;
        options.viewpoint = viewpoint;
        if (!viewpoint && camera_frame) options.viewpoint = Eigen::Vector3d::Zero();
        options.truth_viewpoint = truth_viewpoint;
        options.road_frame = road_frame;
        options.map_cell = map_cell;
        options.mesh_density = mesh_density;
        options.seed = seed;
        options.num_threads = threads;
        return compute([&] { return compare_shapes(from, to, options); });
      },
      py::arg("estimate"), py::arg("truth"), py::kw_only(),
      py::arg("estimate_triangles") = py::none(), py::arg("truth_triangles") = py::none(),
      py::arg("thresholds") = defaults.thresholds, py::arg("align") = "none",
      py::arg("estimate_from_truth") = py::none(), py::arg("up") = py::none(),
      py::arg("along") = py::none(), py::arg("viewpoint") = py::none(),
      py::arg("truth_viewpoint") = py::none(), py::arg("road_frame") = defaults.road_frame,
      py::arg("map_cell") = defaults.map_cell, py::arg("mesh_density") = defaults.mesh_density,
      py::arg("seed") = defaults.seed, py::arg("threads") = defaults.num_threads,
      with_keywords(kDoc_compare_shapes,
                    {{"estimate_triangles", "M x 3 indices of its points: it is a mesh"},
                     {"truth_triangles", "the same of the truth"},
                     {"thresholds", CAMBER_DOC(CompareOptions, thresholds)},
                     {"align", "'none', 'scale', 'rigid' or 'similarity', of the estimate"},
                     {"estimate_from_truth", CAMBER_DOC(CompareOptions, estimate_from_truth)},
                     {"up", "in the frame of the estimate; None: its default_up"},
                     {"along",
                      "the road's direction, level part taken; None: the camera's axis of an "
                      "estimate in a camera's frame, else x"},
                     {"viewpoint",
                      "of the estimate, for bins by distance; None: the camera of an estimate in "
                      "a camera's frame, else unknown"},
                     {"truth_viewpoint", CAMBER_DOC(CompareOptions, truth_viewpoint)},
                     {"road_frame", CAMBER_DOC(CompareOptions, road_frame)},
                     {"map_cell", CAMBER_DOC(CompareOptions, map_cell)},
                     {"mesh_density", CAMBER_DOC(CompareOptions, mesh_density)}})
          .c_str());
}

}  // namespace camber::python
