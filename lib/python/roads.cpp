#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/plane/fit_plane.h"
#include "camber/road/fit_road_surface.h"
#include "camber/road/road_profile.h"
#include "camber/road/segment_ground.h"
#include "camber/scene/results.h"
#include "convert.h"
#include "running.h"

namespace camber::python {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

template <typename T>
std::string status_of(const T& result) {
  return std::string(to_string(result.status));
}

void bind_patches(py::module_& module) {
  py::class_<PlanePatch>(module, "PlanePatch", kDoc_PlanePatch)
      .CAMBER_FIELD(PlanePatch, id)
      .def_property_readonly(
          "kind", [](const PlanePatch& p) { return std::string(to_string(p.kind)); },
          "'road', 'pavement' or 'other'")
      .def_property_readonly("status", &status_of<PlanePatch>, kDoc_Status)
      .CAMBER_FIELD(PlanePatch, reason)
      .CAMBER_FIELD(PlanePatch, plane)
      .CAMBER_FIELD(PlanePatch, inliers)
      .CAMBER_FIELD(PlanePatch, noise)
      .CAMBER_FIELD(PlanePatch, unmodelled_sigma)
      .def_property_readonly(
          "boundary",
          [](const py::object& self) { return view_of(self.cast<PlanePatch&>().boundary, self); },
          CAMBER_DOC(PlanePatch, boundary))
      .CAMBER_FIELD(PlanePatch, grade)
      .CAMBER_FIELD(PlanePatch, bank)
      .CAMBER_FIELD(PlanePatch, refinement)
      .def("__repr__", [](const PlanePatch& p) {
        return fmt::format(
            "<camber.PlanePatch {} ({}, {}): {} points, grade {:+.2f} deg, bank {:+.2f} deg>", p.id,
            to_string(p.kind), to_string(p.status), p.inliers, p.grade / kDegree, p.bank / kDegree);
      });
  py::class_<PatchLink>(module, "PatchLink", kDoc_PatchLink)
      .def_readonly("a", &PatchLink::a, "patch id")
      .def_readonly("b", &PatchLink::b, "patch id")
      .CAMBER_FIELD(PatchLink, valid)
      .CAMBER_FIELD(PatchLink, reason)
      .CAMBER_FIELD(PatchLink, weight)
      .CAMBER_FIELD(PatchLink, distance)
      .CAMBER_FIELD(PatchLink, height_step)
      .CAMBER_FIELD(PatchLink, angle)
      .CAMBER_FIELD(PatchLink, residual_sigma)
      .def("__repr__", [](const PatchLink& link) {
        return fmt::format("<camber.PatchLink {} to {}{}{}: step {:+.3f} m>", link.a, link.b,
                           link.valid ? "" : ", not valid: ", link.reason, link.height_step);
      });
}

void bind_surface(py::module_& module) {
  py::class_<SurfaceQuery>(module, "SurfaceQuery", kDoc_SurfaceQuery)
      .def_property_readonly("status", &status_of<SurfaceQuery>, CAMBER_DOC(SurfaceQuery, status))
      .CAMBER_FIELD(SurfaceQuery, reason)
      .CAMBER_FIELD(SurfaceQuery, patch)
      .CAMBER_FIELD(SurfaceQuery, plane)
      .CAMBER_FIELD(SurfaceQuery, point)
      .CAMBER_FIELD(SurfaceQuery, sigma_height)
      .def("__repr__", [](const SurfaceQuery& q) {
        if (q.status == Status::kFailed) return fmt::format("<camber.SurfaceQuery {}>", q.reason);
        return fmt::format("<camber.SurfaceQuery ({:.3f}, {:.3f}, {:.3f}) +- {:.3f}, patch {}>",
                           q.point.x(), q.point.y(), q.point.z(), q.sigma_height, q.patch);
      });
  py::class_<RoadSurface>(module, "RoadSurface", kDoc_RoadSurface)
      .CAMBER_FIELD(RoadSurface, frame)
      .CAMBER_FIELD(RoadSurface, up)
      .def_property_readonly(
          "level", [](const RoadSurface& s) { return std::string(to_string(s.level)); },
          "'camera' or 'gravity': what grades and banks are against")
      .CAMBER_FIELD(RoadSurface, level_sigma)
      .CAMBER_FIELD(RoadSurface, metric)
      .CAMBER_FIELD(RoadSurface, scale_sigma)
      .CAMBER_FIELD(RoadSurface, ego_patch)
      .CAMBER_FIELD(RoadSurface, patches)
      .CAMBER_FIELD(RoadSurface, links)
      .def_property_readonly(
          "driven_line",
          [](const py::object& self) {
            return view_of(self.cast<RoadSurface&>().driven_line, self);
          },
          CAMBER_DOC(RoadSurface, driven_line))
      .def("find", &RoadSurface::find, py::arg("id"), py::return_value_policy::reference_internal,
           "The patch of an id; not found: None.")
      .def("query", &RoadSurface::query, py::arg("place"), py::arg("reach") = 2.0,
           kDoc_RoadSurface_query)
      .def("query_ray", &RoadSurface::query_ray, py::arg("origin"), py::arg("direction"),
           py::arg("reach") = 2.0, kDoc_RoadSurface_query_ray)
      .def(
          "to_dict", [](const RoadSurface& s) { return to_python(to_json(s)); },
          "As surface.json has it.")
      .def("__repr__", [](const RoadSurface& s) {
        const auto road = std::count_if(s.patches.begin(), s.patches.end(),
                                        [](const auto& p) { return p.kind == PatchKind::kRoad; });
        return fmt::format(
            "<camber.RoadSurface {} patches, {} of them road, frame {}{}>", s.patches.size(), road,
            s.frame,
            s.metric ? fmt::format(", scale +- {:.1f} %", 100.0 * s.scale_sigma) : ", up to scale");
      });
  module.def(
      "read_surface", [](const std::filesystem::path& path) { return read_surface(path); },
      py::arg("path"), "Reads a surface.json.");
}

void bind_profile(py::module_& module) {
  py::class_<ProfilePoint>(module, "ProfilePoint", kDoc_ProfilePoint)
      .CAMBER_FIELD(ProfilePoint, station)
      .def_property_readonly("status", &status_of<ProfilePoint>, CAMBER_DOC(ProfilePoint, status))
      .CAMBER_FIELD(ProfilePoint, reason)
      .CAMBER_FIELD(ProfilePoint, patch)
      .CAMBER_FIELD(ProfilePoint, point)
      .CAMBER_FIELD(ProfilePoint, height)
      .CAMBER_FIELD(ProfilePoint, grade)
      .CAMBER_FIELD(ProfilePoint, cross_slope)
      .CAMBER_FIELD(ProfilePoint, vertical_radius)
      .CAMBER_FIELD(ProfilePoint, vertical_curvature)
      .CAMBER_FIELD(ProfilePoint, sigma_height)
      .CAMBER_FIELD(ProfilePoint, sigma_grade)
      .CAMBER_FIELD(ProfilePoint, sigma_cross_slope)
      .CAMBER_FIELD(ProfilePoint, sigma_vertical_curvature)
      .def("__repr__", [](const ProfilePoint& p) {
        return fmt::format("<camber.ProfilePoint at {:.1f} m: height {:.3f} +- {:.3f} m>",
                           p.station, p.height, p.sigma_height);
      });
  const ProfileOptions defaults;
  module.def(
      "road_profile",
      [](const RoadSurface& surface, const py::object& line, double step, double length,
         double reach, std::optional<double> levelling_sigma, double drift_sigma) {
        ProfileOptions options;
        options.step = step;
        options.length = length;
        options.reach = reach;
        if (surface.level_sigma > 0.0) options.levelling_sigma = surface.level_sigma;
        if (levelling_sigma) options.levelling_sigma = *levelling_sigma;
        options.drift_sigma = drift_sigma;
        const std::vector<Eigen::Vector3d> places =
            line.is_none() ? surface.driven_line : to_points(line, "line");
        return compute([&] { return road_profile(surface, places, options); });
      },
      py::arg("surface"), py::arg("line") = py::none(), py::kw_only(),
      py::arg("step") = defaults.step, py::arg("length") = defaults.length,
      py::arg("reach") = defaults.reach, py::arg("levelling_sigma") = py::none(),
      py::arg("drift_sigma") = defaults.drift_sigma,
      with_keywords(kDoc_road_profile, {{"line", "N x 3; None: the surface's driven line"},
                                        {"step", CAMBER_DOC(ProfileOptions, step)},
                                        {"length", CAMBER_DOC(ProfileOptions, length)},
                                        {"reach", CAMBER_DOC(ProfileOptions, reach)},
                                        {"levelling_sigma",
                                         "rad, how well up is known: part of the sigmas; None: as "
                                         "the surface states it"},
                                        {"drift_sigma",
                                         "m, how far heights drift along the road: part of the "
                                         "sigmas; of a surface up to scale not used"}})
          .c_str());
}

void bind_plane_fit(py::module_& module) {
  py::class_<PlaneFit>(module, "PlaneFit", "One plane of a cloud.")
      .def_property_readonly("status", &status_of<PlaneFit>, CAMBER_DOC(PlaneFit, status))
      .CAMBER_FIELD(PlaneFit, reason)
      .CAMBER_FIELD(PlaneFit, plane)
      .def_property_readonly(
          "inliers",
          [](const py::object& self) { return view_of(self.cast<PlaneFit&>().inliers, self); },
          CAMBER_DOC(PlaneFit, inliers))
      .CAMBER_FIELD(PlaneFit, num_inliers)
      .CAMBER_FIELD(PlaneFit, noise)
      .def_property_readonly(
          "extent",
          [](const py::object& self) { return view_of(self.cast<PlaneFit&>().extent, self); },
          CAMBER_DOC(PlaneFit, extent))
      .CAMBER_FIELD(PlaneFit, rmse)
      .CAMBER_FIELD(PlaneFit, condition)
      .CAMBER_FIELD(PlaneFit, hypotheses)
      .def("__repr__", [](const PlaneFit& fit) {
        if (fit.status == Status::kFailed) {
          return fmt::format("<camber.PlaneFit failed: {}>", fit.reason);
        }
        const Eigen::Vector3d& n = fit.plane.plane.normal;
        return fmt::format(
            "<camber.PlaneFit {}: normal ({:.4f}, {:.4f}, {:.4f}), {} inliers, rmse {:.4f} m>",
            to_string(fit.status), n.x(), n.y(), n.z(), fit.num_inliers, fit.rmse);
      });
  const PlaneFitOptions defaults;
  module.def(
      "fit_plane",
      [](const py::object& cloud, const std::optional<Eigen::Vector3d>& up, double max_tilt,
         double inlier_threshold, int max_hypotheses, double confidence,
         const std::optional<Eigen::Vector3d>& viewpoint, bool list_inliers, std::uint64_t seed,
         int threads) {
        const CloudArgument argument(cloud, "cloud");
        PlaneFitOptions options;
        options.seed = seed;
        options.num_threads = threads;
        options.up = up.value_or(argument.cloud->default_up());
        options.max_tilt = max_tilt;
        options.inlier_threshold = inlier_threshold;
        options.max_hypotheses = max_hypotheses;
        options.confidence = confidence;
        options.viewpoint = viewpoint;
        options.list_inliers = list_inliers;
        return compute([&] { return fit_plane(*argument.cloud, options); });
      },
      py::arg("cloud"), py::kw_only(), py::arg("up") = py::none(),
      py::arg("max_tilt") = defaults.max_tilt,
      py::arg("inlier_threshold") = defaults.inlier_threshold,
      py::arg("max_hypotheses") = defaults.max_hypotheses,
      py::arg("confidence") = defaults.confidence, py::arg("viewpoint") = py::none(),
      py::arg("list_inliers") = defaults.list_inliers, py::arg("seed") = defaults.seed,
      py::arg("threads") = defaults.num_threads,
      with_keywords(kDoc_fit_plane,
                    {{"up", "the normal is on this side; None: the cloud's default_up"},
                     {"max_tilt", CAMBER_DOC(PlaneFitOptions, max_tilt)},
                     {"inlier_threshold", CAMBER_DOC(PlaneFitOptions, inlier_threshold)},
                     {"max_hypotheses", CAMBER_DOC(PlaneFitOptions, max_hypotheses)},
                     {"confidence", CAMBER_DOC(PlaneFitOptions, confidence)},
                     {"viewpoint", CAMBER_DOC(PlaneFitOptions, viewpoint)},
                     {"list_inliers", CAMBER_DOC(PlaneFitOptions, list_inliers)}})
          .c_str());
}

void bind_surface_fit(py::module_& module) {
  py::class_<RoadSurfaceFit>(module, "RoadSurfaceFit", "The planar patches of a cloud.")
      .def_property_readonly("status", &status_of<RoadSurfaceFit>,
                             CAMBER_DOC(RoadSurfaceFit, status))
      .CAMBER_FIELD(RoadSurfaceFit, reason)
      .CAMBER_FIELD(RoadSurfaceFit, surface)
      .def_property_readonly(
          "labels",
          [](const py::object& self) { return view_of(self.cast<RoadSurfaceFit&>().labels, self); },
          CAMBER_DOC(RoadSurfaceFit, labels))
      .CAMBER_FIELD(RoadSurfaceFit, noise)
      .def("__repr__", [](const RoadSurfaceFit& fit) {
        return fit.status == Status::kFailed
                   ? fmt::format("<camber.RoadSurfaceFit failed: {}>", fit.reason)
                   : fmt::format("<camber.RoadSurfaceFit {}: {} patches, noise {:.4f} m>",
                                 to_string(fit.status), fit.surface.patches.size(), fit.noise);
      });
  const RoadSurfaceOptions defaults;
  module.def(
      "fit_road_surface",
      [](const py::object& cloud, const std::optional<Eigen::Vector3d>& up, double max_slope,
         double inlier_threshold, const std::optional<Eigen::Vector3d>& viewpoint,
         int min_patch_points, double tolerance_sigmas, double tolerance,
         const py::object& driven_line, const std::string& consistency, double link_distance,
         std::uint64_t seed, int threads, const py::object& progress) {
        const CloudArgument argument(cloud, "cloud");
        RoadSurfaceOptions options;
        options.seed = seed;
        options.num_threads = threads;
        options.up = up;
        options.max_slope = max_slope;
        options.inlier_threshold = inlier_threshold;
        options.viewpoint = viewpoint;
        options.min_patch_points = min_patch_points;
        options.tolerance_sigmas = tolerance_sigmas;
        options.tolerance = tolerance;
        if (!driven_line.is_none()) options.driven_line = to_points(driven_line, "driven_line");
        options.consistency.consistency = consistency_of(consistency);
        options.consistency.link_distance = link_distance;
        const Progress report = to_progress(progress);
        return compute([&] { return fit_road_surface(*argument.cloud, options, report); });
      },
      py::arg("cloud"), py::kw_only(), py::arg("up") = py::none(),
      py::arg("max_slope") = defaults.max_slope,
      py::arg("inlier_threshold") = defaults.inlier_threshold, py::arg("viewpoint") = py::none(),
      py::arg("min_patch_points") = defaults.min_patch_points,
      py::arg("tolerance_sigmas") = defaults.tolerance_sigmas,
      py::arg("tolerance") = defaults.tolerance, py::arg("driven_line") = py::none(),
      py::arg("consistency") = "continuity",
      py::arg("link_distance") = defaults.consistency.link_distance,
      py::arg("seed") = defaults.seed, py::arg("threads") = defaults.num_threads,
      py::arg("progress") = py::none(),
      with_keywords(
          kDoc_fit_road_surface,
          {{"up", CAMBER_DOC(RoadSurfaceOptions, up)},
           {"max_slope", CAMBER_DOC(RoadSurfaceOptions, max_slope)},
           {"inlier_threshold", CAMBER_DOC(RoadSurfaceOptions, inlier_threshold)},
           {"viewpoint", CAMBER_DOC(PlaneFitOptions, viewpoint)},
           {"min_patch_points", CAMBER_DOC(RoadSurfaceOptions, min_patch_points)},
           {"tolerance_sigmas", CAMBER_DOC(RoadSurfaceOptions, tolerance_sigmas)},
           {"tolerance", "m, the same at least"},
           {"driven_line", CAMBER_DOC(RoadSurfaceOptions, driven_line)},
           {"consistency", "'continuity': neighbours meet at equal heights; 'paper'; 'none'"},
           {"link_distance", CAMBER_DOC(ConsistencyOptions, link_distance)},
           {"progress", "called with the stage's name and the share done"}})
          .c_str());
}

void bind_ground(py::module_& module) {
  py::class_<GroundSegmentation>(module, "GroundSegmentation", kDoc_GroundSegmentation)
      .def_property_readonly("status", &status_of<GroundSegmentation>,
                             CAMBER_DOC(GroundSegmentation, status))
      .CAMBER_FIELD(GroundSegmentation, reason)
      .def_property_readonly(
          "labels",
          [](const py::object& self) {
            return view_of(self.cast<GroundSegmentation&>().labels, self);
          },
          CAMBER_DOC(GroundSegmentation, labels))
      .CAMBER_FIELD(GroundSegmentation, ground)
      .CAMBER_FIELD(GroundSegmentation, from_air)
      .CAMBER_FIELD(GroundSegmentation, cell)
      .CAMBER_FIELD(GroundSegmentation, largest_object)
      .CAMBER_FIELD(GroundSegmentation, slope)
      .CAMBER_FIELD(GroundSegmentation, tolerance)
      .def("__repr__", [](const GroundSegmentation& g) {
        return g.status == Status::kFailed
                   ? fmt::format("<camber.GroundSegmentation failed: {}>", g.reason)
                   : fmt::format("<camber.GroundSegmentation {} of {} points, within {:.2f} m>",
                                 g.ground, g.labels.size(), g.tolerance);
      });
  const GroundOptions defaults;
  module.def(
      "segment_ground",
      [](const py::object& cloud, const std::optional<Eigen::Vector3d>& up,
         std::optional<double> sensor_height, double cell, double largest_object, double slope,
         double tolerance) {
        const CloudArgument argument(cloud, "cloud");
        GroundOptions options;
        options.up = up.value_or(argument.cloud->default_up());
        if (sensor_height) options.sensor_height = *sensor_height;
        options.cell = cell;
        options.largest_object = largest_object;
        options.slope = slope;
        options.tolerance = tolerance;
        return compute([&] { return segment_ground(*argument.cloud, options); });
      },
      py::arg("cloud"), py::kw_only(), py::arg("up") = py::none(),
      py::arg("sensor_height") = py::none(), py::arg("cell") = defaults.cell,
      py::arg("largest_object") = defaults.largest_object, py::arg("slope") = defaults.slope,
      py::arg("tolerance") = defaults.tolerance,
      with_keywords(kDoc_segment_ground,
                    {{"up", "in the cloud's frame; None: the cloud's default_up"},
                     {"sensor_height", CAMBER_DOC(GroundOptions, sensor_height)},
                     {"cell", CAMBER_DOC(GroundOptions, cell)},
                     {"largest_object", CAMBER_DOC(GroundOptions, largest_object)},
                     {"slope", CAMBER_DOC(GroundOptions, slope)},
                     {"tolerance", CAMBER_DOC(GroundOptions, tolerance)}})
          .c_str());
}

}  // namespace

Consistency consistency_of(const std::string& name) {
  static const std::map<std::string, Consistency> kNames{{"none", Consistency::kNone},
                                                         {"paper", Consistency::kPaper},
                                                         {"continuity", Consistency::kContinuity}};
  const auto found = kNames.find(name);
  if (found == kNames.end()) {
    throw std::invalid_argument("consistency: found '" + name +
                                "', expected 'continuity', 'paper' or 'none'");
  }
  return found->second;
}

void bind_roads(py::module_& module) {
  bind_patches(module);
  bind_surface(module);
  bind_profile(module);
  bind_plane_fit(module);
  bind_surface_fit(module);
  bind_ground(module);
}

}  // namespace camber::python
