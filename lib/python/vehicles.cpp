#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "camber/scene/results.h"
#include "camber/vehicle/vehicle_estimate.h"
#include "convert.h"

namespace camber::python {
namespace {

void bind_estimate(py::module_& module) {
  py::class_<VehicleEstimate>(module, "VehicleEstimate", kDoc_VehicleEstimate)
      .CAMBER_FIELD(VehicleEstimate, id)
      .CAMBER_FIELD(VehicleEstimate, vehicle_class)
      .CAMBER_FIELD(VehicleEstimate, track)
      .CAMBER_FIELD(VehicleEstimate, box)
      .def_property_readonly(
          "status", [](const VehicleEstimate& v) { return std::string(to_string(v.status)); },
          kDoc_Status)
      .CAMBER_FIELD(VehicleEstimate, reason)
      .CAMBER_FIELD(VehicleEstimate, pose)
      .def_property_readonly(
          "keypoints",
          [](const py::object& self) {
            auto& v = self.cast<VehicleEstimate&>();
            return view(v.keypoints[0].data(), {kNumKeypoints, 3}, self);
          },
          "36 x 3, camera frame, m; NaN: not known")
      .CAMBER_FIELD(VehicleEstimate, plane)
      .CAMBER_FIELD(VehicleEstimate, plane_sigma_height)
      .CAMBER_FIELD(VehicleEstimate, plane_source)
      .CAMBER_FIELD(VehicleEstimate, shape)
      .CAMBER_FIELD(VehicleEstimate, covariance)
      .CAMBER_FIELD(VehicleEstimate, reprojection_rmse_px)
      .CAMBER_FIELD(VehicleEstimate, keypoint_cost)
      .def("__repr__", [](const VehicleEstimate& v) {
        const Eigen::Vector3d center = v.pose.center();
        return fmt::format(
            "<camber.VehicleEstimate {} {} ({}): {:.2f} m ahead, {:.2f} m right, "
            "{:.2f} m down>",
            v.vehicle_class, v.id, to_string(v.status), center.z(), center.x(), center.y());
      });
}

void bind_documents(py::module_& module) {
  py::class_<VehicleFrame>(module, "VehicleFrame", kDoc_VehicleFrame)
      .CAMBER_FIELD(VehicleFrame, id)
      .CAMBER_FIELD(VehicleFrame, vehicles)
      .def("__repr__", [](const VehicleFrame& frame) {
        return fmt::format("<camber.VehicleFrame {} with {} vehicles>", frame.id,
                           frame.vehicles.size());
      });
  py::class_<VehicleDocument>(module, "VehicleDocument", "The vehicles of a run, by frame.")
      .CAMBER_FIELD(VehicleDocument, method)
      .CAMBER_FIELD(VehicleDocument, preset)
      .CAMBER_FIELD(VehicleDocument, paper_terms)
      .CAMBER_FIELD(VehicleDocument, keypoint_set)
      .CAMBER_FIELD(VehicleDocument, detections_source)
      .CAMBER_FIELD(VehicleDocument, metric)
      .CAMBER_FIELD(VehicleDocument, frames)
      .def(
          "to_dict", [](const VehicleDocument& d) { return to_python(to_json(d)); },
          "As vehicles.json has it.")
      .def("__repr__", [](const VehicleDocument& d) {
        std::size_t count = 0;
        for (const VehicleFrame& frame : d.frames) count += frame.vehicles.size();
        return fmt::format("<camber.VehicleDocument {} vehicles in {} frames, method {}>", count,
                           d.frames.size(), d.method);
      });
}

void bind_run(py::module_& module) {
  py::class_<ConstraintReport>(module, "ConstraintReport", "A source of road or scale.")
      .CAMBER_FIELD(ConstraintReport, name)
      .CAMBER_FIELD(ConstraintReport, source)
      .CAMBER_FIELD(ConstraintReport, residual_sigma)
      .CAMBER_FIELD(ConstraintReport, accepted)
      .CAMBER_FIELD(ConstraintReport, reason)
      .def("__repr__", [](const ConstraintReport& c) {
        return fmt::format("<camber.ConstraintReport {}: {}, {:+.2f} standard deviations>", c.name,
                           c.accepted ? "accepted" : c.reason, c.residual_sigma);
      });
  py::class_<RunDocument>(module, "RunDocument",
                          "What a run was and what it found beside its road.")
      .CAMBER_FIELD(RunDocument, seed)
      .def_property_readonly(
          "timings",
          [](const RunDocument& run) {
            py::dict out;
            for (const auto& [stage, ms] : run.timings.stages()) {
              out[py::str(stage)] = ms;
            }
            return out;
          },
          "wall-clock milliseconds by stage")
      .def_property_readonly(
          "cameras",
          [](const RunDocument& run) {
            std::map<int, Eigen::Matrix4d> out;
            for (const auto& camera : run.cameras) {
              out[camera.id] = to_matrix(camera.reference_from_camera);
            }
            return out;
          },
          "reference_from_camera by frame id, 4 x 4, metres")
      .CAMBER_FIELD(RunDocument, metric)
      .CAMBER_FIELD(RunDocument, scale)
      .CAMBER_FIELD(RunDocument, scale_sigma)
      .def_property_readonly(
          "scale_status",
          [](const RunDocument& run) { return std::string(to_string(run.scale_status)); },
          kDoc_Status)
      .CAMBER_FIELD(RunDocument, scale_reason)
      .CAMBER_FIELD(RunDocument, scene)
      .def_property_readonly(
          "warnings",
          [](const RunDocument& run) {
            std::map<std::string, std::string> out;
            for (const auto& w : run.warnings) out[w.code] = w.text;
            return out;
          },
          "sentences by code")
      .CAMBER_FIELD(RunDocument, constraints)
      .CAMBER_FIELD(RunDocument, points_kept)
      .CAMBER_FIELD(RunDocument, points_dropped)
      .CAMBER_FIELD(RunDocument, input_hashes)
      .def(
          "to_dict", [](const RunDocument& run) { return to_python(to_json(run)); },
          "As run.json has it.")
      .def("__repr__", [](const RunDocument& run) {
        return run.metric ? fmt::format("<camber.RunDocument {} cameras, scale {} +- {:.1f} %>",
                                        run.cameras.size(), to_string(run.scale_status),
                                        100.0 * run.scale_sigma)
                          : fmt::format("<camber.RunDocument {} cameras, up to scale>",
                                        run.cameras.size());
      });
}

}  // namespace

void bind_vehicles(py::module_& module) {
  bind_estimate(module);
  bind_documents(module);
  bind_run(module);
  module.def(
      "read_vehicles", [](const std::filesystem::path& path) { return read_vehicles(path); },
      py::arg("path"), "Reads a vehicles.json.");
  module.def(
      "read_run", [](const std::filesystem::path& path) { return read_run(path); }, py::arg("path"),
      "Reads a run.json.");
}

}  // namespace camber::python
