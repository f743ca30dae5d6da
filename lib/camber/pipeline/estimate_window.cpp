#include "camber/pipeline/estimate_window.h"

#include <optional>
#include <utility>

namespace camber {

ReconstructOptions handed_down(const ReconstructOptions& options) {
  ReconstructOptions out = options;
  out.motion.seed = options.seed;
  out.vehicles.enabled = options.vehicles.enabled;
  out.surface.under_vehicles =
      options.vehicles.enabled && options.vehicles.method == VehicleMethod::kJoint;
  out.vehicles.noise = options.scale.noise;
  for (int* threads : {&out.load.num_threads, &out.match.flow.num_threads, &out.motion.num_threads,
                       &out.ground.num_threads, &out.scale.num_threads, &out.surface.num_threads,
                       &out.vehicles.num_threads}) {
    *threads = options.num_threads;
  }
  return out;
}

WindowEstimate estimate_window(const Scene& scene, LoadedFrames frames,
                               const ReconstructOptions& options, const StageRunner& run) {
  ReconstructOptions o = options;
  if (frames.box_sigma_px) o.vehicles.fit.noise.box.pixel_sigma = *frames.box_sigma_px;
  FoundRoad road =
      stages::find_road(scene, std::move(frames), {o.rounds, o.match, o.motion, o.ground}, run);
  PhotometricGround refined = run("ground", 0.8, [&] {
    return o.photometric && !road.ground.by_what_passes
               ? stages::refine_photometrically(road.frames, road.matches, road.motion, road.ground,
                                                o.ground)
               : PhotometricGround{road.ground, road.motion, nullptr, {}, {}, {}};
  });
  ScaledRoad scaled = run(
      "scale", 0.83, [&] { return stages::scale(road.frames, road.matches, refined, o.scale); });
  SurfacePlan plan = run("surface", 0.85, [&] {
    return stages::surface(road.frames, road.matches, refined.motion, refined.ground, scaled.road,
                           o.surface);
  });
  PlacedVehicles vehicles = run("vehicles", 0.9, [&] {
    return stages::vehicles(road.frames, refined.motion, scaled, plan, o.vehicles);
  });
  JudgedRoad judged = run("scale", 0.97, [&] {
    std::optional<RoadLayer> layer;  // of matches
    if (!refined.ground.by_what_passes) {
      layer = stages::road_layer(road.frames, road.matches, refined,
                                 scaled.road.metres_per_baseline(), o.num_threads);
    }
    return stages::judge(scaled, layer, vehicles, {o.scale.noise});
  });
  AssembledRoad assembled = run("surface", 0.98, [&] {
    return stages::assemble(road.frames, road.matches, refined, scaled, plan, vehicles, judged,
                            o.vehicles.method, {o.num_threads, o.scale.noise});
  });
  return {std::move(road),     std::move(refined), std::move(scaled),   std::move(plan),
          std::move(vehicles), std::move(judged),  std::move(assembled)};
}

}  // namespace camber
