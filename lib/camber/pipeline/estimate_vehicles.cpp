#include "camber/pipeline/estimate_vehicles.h"

#include <algorithm>
#include <stdexcept>

namespace camber {

void EstimateVehiclesOptions::validate() const {
  if (method != "joint" && method != "coplanar" && method != "flat") {
    throw std::invalid_argument("method: \"" + method + "\", must be joint, coplanar or flat");
  }
  fit.validate();
  support.validate();
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
  VehicleFitOptions fit = options.fit;
  fit.trust_plane = options.method != "joint";

  VehicleDocument out;
  out.method = options.method;
  out.detections_source = scene.detections_source;
  out.metric = scene.height_above_road.has_value();
  for (std::size_t k = 0; k < frame_ids.size(); ++k) {
    if (progress) progress("vehicles", static_cast<double>(k) / frame_ids.size());
    const SceneFrame* frame = scene.find_frame(frame_ids[k]);
    if (!frame) {
      throw std::invalid_argument("frame_ids: " + std::to_string(frame_ids[k]) +
                                  " is not in the scene");
    }
    std::vector<SupportPlane> supports;
    for (const VehicleDetection& detection : frame->vehicles) {
      if (options.method == "flat") {
        supports.push_back(certain_support({{0.0, -1.0, 0.0}, height}, "level"));
      } else if (options.method == "coplanar") {
        supports.push_back(frame->ego_plane ? certain_support(*frame->ego_plane, "ego")
                                            : certain_support({{0.0, -1.0, 0.0}, height}, "level"));
      } else if (detection.has_plane) {
        supports.push_back(given_support(scene.camera, detection, options.support));
      } else if (frame->ego_plane) {
        supports.push_back(ego_support(*frame->ego_plane, options.support));
      } else {
        supports.push_back(level_support(height, wide));
      }
    }
    out.frames.push_back({frame->id, fit_vehicles(scene.camera, frame->vehicles, supports, fit,
                                                  options.num_threads)});
  }
  if (progress) progress("vehicles", 1.0);
  return out;
}

}  // namespace camber
