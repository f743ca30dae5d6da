#include "camber/pipeline/estimate_vehicles.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <stdexcept>

#include "camber/cloud/number_text.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

/// The patch below a detection: where its box's bottom ray meets the surface.
std::optional<SupportPlane> patch_below(const RoadSurface& surface,
                                        const SE3& reference_from_camera,
                                        const PinholeCamera& camera,
                                        const VehicleDetection& detection,
                                        const SupportOptions& options) {
  constexpr double kReach = 5.0;  // m, beyond a patch's boundary
  const Eigen::Vector3d ray =
      camera.ray({detection.box.center().x(), std::min(detection.box.y2, camera.height - 1.0)});
  const SurfaceQuery query = surface.query_ray(reference_from_camera.translation(),
                                               reference_from_camera.rotation() * ray, kReach);
  if (query.status == Status::kFailed) return std::nullopt;
  SupportPlane out;
  out.plane = query.plane.transformed(reference_from_camera.inverse());
  out.source = "patch " + std::to_string(query.patch);
  out.status = query.status;
  out.unmodelled_height = options.road_unmodelled_height;
  return out;
}

std::optional<SupportPlane> ego_below(const RoadSurface& surface,
                                      const SE3& reference_from_camera) {
  const PlanePatch* ego = surface.find(surface.ego_patch);
  if (!ego) return std::nullopt;
  SupportPlane out;
  out.plane = ego->plane.transformed(reference_from_camera.inverse());
  out.source = "ego";
  out.status = ego->status;
  return out;
}

const RunDocument::CameraPose* find_camera(const EstimateVehiclesOptions& options, int frame) {
  if (!options.cameras) return nullptr;
  for (const RunDocument::CameraPose& camera : *options.cameras) {
    if (camera.id == frame) return &camera;
  }
  return nullptr;
}

/// What is known of the ground of one frame: by a run's surface, else by the scene.
FrameGround ground_of(const Scene& scene, const SceneFrame& frame, const RoadSurface& surface,
                      const RunDocument::CameraPose* seen, const EstimateVehiclesOptions& options) {
  FrameGround out;
  if (seen) {
    out.ego = ego_below(surface, seen->reference_from_camera);
    for (const VehicleDetection& detection : frame.vehicles) {
      out.local.push_back(patch_below(surface, seen->reference_from_camera, scene.camera, detection,
                                      options.vehicles.support));
    }
  }
  if (!out.ego && frame.ego_plane) {
    out.ego = ego_support(*frame.ego_plane, options.vehicles.support);
  }
  return out;
}

}  // namespace

void EstimateVehiclesOptions::validate() const {
  if (preset == Preset::kPaper && vehicles.method == VehicleMethod::kReprojection) {
    throw std::invalid_argument(
        "method: reprojection, must be joint, coplanar or flat with preset paper");
  }
  vehicles.fit.validate();
  vehicles.support.validate();
  paper.weights.validate();
  if (!surface != !cameras) {
    throw std::invalid_argument("surface, cameras: one without the other, must be both or neither");
  }
}

VehicleDocument estimate_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                  const EstimateVehiclesOptions& options,
                                  const Progress& progress) {
  options.validate();
  RoadSurface surface;
  if (options.surface) {
    surface = *options.surface;
    for (PlanePatch& patch : surface.patches) {
      if (patch.without_vehicle) patch.plane = *patch.without_vehicle;
    }
  }
  std::vector<TrackFrame> views;
  bool poses_known = frame_ids.size() > 1;
  for (const int id : frame_ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (!frame) {
      throw std::invalid_argument("frame_ids: " + std::to_string(id) + " is not in the scene");
    }
    const RunDocument::CameraPose* seen = find_camera(options, id);
    TrackFrame view;
    view.time_s = time_of(*frame, scene.frame_rate.value_or(10.0));
    view.detections = frame->vehicles;
    if (seen) {
      view.world_from_camera = seen->reference_from_camera;
    } else if (!options.cameras && frame->world_from_camera) {
      view.world_from_camera = *frame->world_from_camera;
    } else {
      poses_known = false;
    }
    view.supports = stages::choose_supports(scene.camera, frame->vehicles,
                                            ground_of(scene, *frame, surface, seen, options),
                                            scene.height_above_road, options.vehicles);
    views.push_back(std::move(view));
  }

  if (progress) progress("vehicles", 0.0);
  stages::VehicleOptions place = options.vehicles;
  place.tracks = place.tracks && poses_known;
  if (scene.box_sigma_px) place.fit.noise.box.pixel_sigma = *scene.box_sigma_px;
  const PlacedVehicles placed =
      options.preset == Preset::kPaper
          ? stages::place_paper_vehicles(scene.camera, std::move(views), place, options.paper)
          : stages::place_vehicles(
                scene.camera, std::move(views), nullptr,
                options.surface ? options.surface->scale_sigma : place.noise.known_pose_scale,
                place);
  VehicleDocument out;
  out.method = to_string(options.vehicles.method);
  out.preset = to_string(options.preset);
  if (options.preset == Preset::kPaper) out.paper_terms = paper::to_string(options.paper.terms);
  out.keypoint_set = static_cast<int>(options.vehicles.fit.keypoint_set);
  out.detections_source = scene.detections_source;
  out.metric = options.surface ? options.surface->metric : scene.height_above_road.has_value();
  for (std::size_t k = 0; k < frame_ids.size(); ++k) {
    std::vector<VehicleEstimate> vehicles = placed.estimates[k];
    for (std::size_t j = 0; j < vehicles.size(); ++j) vehicles[j].track = placed.tracks[k][j];
    out.frames.push_back({frame_ids[k], std::move(vehicles)});
  }
  if (progress) progress("vehicles", 1.0);
  return out;
}

std::vector<std::string> unknown_classes(const std::vector<SceneFrame>& frames,
                                         const VehiclePrior* prior) {
  const VehiclePrior& known = prior ? *prior : shipped_vehicle_prior();
  std::map<std::string, int> unknown;
  for (const SceneFrame& frame : frames) {
    for (const VehicleDetection& vehicle : frame.vehicles) {
      const std::string name = lower_case(vehicle.vehicle_class);
      if (known.size(name).name != name) ++unknown[vehicle.vehicle_class];
    }
  }
  std::vector<std::string> out;
  for (const auto& [name, count] : unknown) {
    out.push_back(fmt::format("class \"{}\" of {} detection{} is not known: taken as {}", name,
                              count, count == 1 ? "" : "s", known.shapes.front().name));
  }
  return out;
}

}  // namespace camber
