#include "camber/pipeline/estimate_vehicles.h"

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "camber/vehicle/vehicle_tracks.h"

namespace camber {

namespace {

/// The patch below a detection: where its box's bottom ray meets the surface.
std::optional<SupportPlane> surface_support(const RoadSurface& surface,
                                            const SE3& camera_from_reference,
                                            const PinholeCamera& camera,
                                            const VehicleDetection& detection) {
  const PlanePatch* ego = surface.find(surface.ego_patch);
  if (!ego) return std::nullopt;
  const SE3 reference_from_camera = camera_from_reference.inverse();
  const Eigen::Vector3d ray =
      camera.ray({detection.box.center().x(), std::min(detection.box.y2, camera.height - 1.0)});
  SupportPlane out;
  out.plane = ego->plane.transformed(camera_from_reference);
  out.source = "ego";
  out.status = ego->status;
  // From where the ego plane is met, along the ray, patch by patch.
  for (int iteration = 0; iteration < 8; ++iteration) {
    Eigen::Vector3d place = 20.0 * ray;
    if (const auto hit = out.plane.plane.intersect_ray(ray)) {
      if (hit->z() > 1.0 && hit->z() < 150.0) place = *hit;
    }
    const SurfaceQuery query = surface.query(reference_from_camera * place, 5.0);
    if (query.status == Status::kFailed || query.patch < 0) break;
    const std::string source = "patch " + std::to_string(query.patch);
    out.plane = query.plane.transformed(camera_from_reference);
    const bool same = source == out.source;
    out.source = source;
    out.status = query.status;
    if (same) break;
  }
  return out;
}

}  // namespace

void EstimateVehiclesOptions::validate() const {
  if (method != "joint" && method != "coplanar" && method != "flat") {
    throw std::invalid_argument("method: \"" + method + "\", must be joint, coplanar or flat");
  }
  fit.validate();
  support.validate();
  if (one_problem) joint.validate();
  if (!surface != !cameras) {
    throw std::invalid_argument("surface, cameras: one without the other, must be both or neither");
  }
}

VehicleDocument estimate_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                  const EstimateVehiclesOptions& options,
                                  const Progress& progress) {
  options.validate();
  constexpr double kUsualHeight = 1.65;       // m, of a camera on a car
  constexpr double kUsualHeightSigma = 0.25;  // m
  const double height = scene.height_above_road.value_or(kUsualHeight);
  SupportOptions wide = options.support;
  if (!scene.height_above_road) {
    wide.level_sigma_height = std::max(wide.level_sigma_height, kUsualHeightSigma);
  }
  // What the run's own vehicles told of their ground is not to be told again.
  RoadSurface ground;
  if (options.surface) {
    ground = *options.surface;
    for (PlanePatch& patch : ground.patches) {
      if (patch.without_vehicle) patch.plane = *patch.without_vehicle;
    }
  }
  VehicleFitOptions fit = options.fit;
  fit.trust_plane = options.method != "joint";

  VehicleDocument out;
  out.method = options.method;
  out.detections_source = scene.detections_source;
  out.metric = options.surface ? options.surface->metric : scene.height_above_road.has_value();
  JointFitOptions joint = options.joint;
  joint.prior = options.fit.prior;
  joint.keypoint_set = options.fit.keypoint_set;
  bool poses_known = true;
  std::vector<TrackFrame> frames;
  for (std::size_t k = 0; k < frame_ids.size(); ++k) {
    if (progress) progress("vehicles", static_cast<double>(k) / frame_ids.size());
    const SceneFrame* frame = scene.find_frame(frame_ids[k]);
    if (!frame) {
      throw std::invalid_argument("frame_ids: " + std::to_string(frame_ids[k]) +
                                  " is not in the scene");
    }
    const RunDocument::CameraPose* seen = nullptr;
    if (options.cameras) {
      for (const RunDocument::CameraPose& c : *options.cameras) {
        if (c.id == frame->id) seen = &c;
      }
    }
    TrackFrame now;
    now.time_s = frame->time_s.value_or(frame->id / scene.frame_rate.value_or(10.0));
    now.detections = frame->vehicles;
    if (seen) {
      now.world_from_camera = seen->reference_from_camera;
    } else if (!options.cameras && frame->world_from_camera) {
      now.world_from_camera = *frame->world_from_camera;
    } else {
      poses_known = false;
    }
    std::vector<SupportPlane>& supports = now.supports;
    for (const VehicleDetection& detection : frame->vehicles) {
      if (options.method == "flat") {
        supports.push_back(certain_support({{0.0, -1.0, 0.0}, height}, "level"));
      } else if (options.method == "coplanar" && seen &&
                 options.surface->find(options.surface->ego_patch)) {
        const UncertainPlane& ego = options.surface->find(options.surface->ego_patch)->plane;
        supports.push_back(
            certain_support(ego.transformed(seen->reference_from_camera.inverse()).plane, "ego"));
      } else if (options.method == "coplanar") {
        supports.push_back(frame->ego_plane ? certain_support(*frame->ego_plane, "ego")
                                            : certain_support({{0.0, -1.0, 0.0}, height}, "level"));
      } else if (auto found = seen ? surface_support(ground, seen->reference_from_camera.inverse(),
                                                     scene.camera, detection)
                                   : std::nullopt) {
        supports.push_back(std::move(*found));
      } else if (detection.has_plane) {
        supports.push_back(given_support(scene.camera, detection, options.support));
      } else if (frame->ego_plane) {
        supports.push_back(ego_support(*frame->ego_plane, options.support));
      } else {
        supports.push_back(level_support(height, wide));
      }
    }
    now.estimates = fit_vehicles(scene.camera, frame->vehicles, supports, fit, options.num_threads);
    if (options.one_problem) {
      now.estimates =
          fit_joint(scene.camera, frame->vehicles, supports, now.estimates, joint).vehicles;
    }
    frames.push_back(std::move(now));
  }
  std::vector<std::vector<VehicleEstimate>> vehicles;
  if (options.tracks && options.method == "joint" && !options.one_problem && poses_known &&
      frames.size() > 1) {
    vehicles = fit_tracks(scene.camera, frames, fit, options.num_threads).estimates;
  } else {
    for (TrackFrame& f : frames) vehicles.push_back(std::move(f.estimates));
  }
  for (std::size_t k = 0; k < frame_ids.size(); ++k) {
    out.frames.push_back({frame_ids[k], std::move(vehicles[k])});
  }
  if (progress) progress("vehicles", 1.0);
  return out;
}

}  // namespace camber
