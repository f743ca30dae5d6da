#include "camber/pipeline/reconstruct.h"

#include <stdexcept>

#include "camber/pipeline/reconstruct_image.h"
#include "camber/pipeline/reconstruct_paper.h"
#include "camber/pipeline/run_details.h"
#include "camber/pipeline/see_road.h"
#include "camber/pipeline/stage_runner.h"
#include "camber/pipeline/stages/fuse_masks.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/pipeline/stages/level.h"
#include "camber/pipeline/stages/reach.h"
#include "camber/scene/georeference.h"

namespace camber {
namespace {

/// Options with seed and threads handed down.
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

Image road_mask_of(const LoadedFrames& frames) {
  if (!frames.masks_by_network || !frames.has_masks()) return {};
  const FrameMasks& masks = frames.reference_masks();
  Image out{frames.camera.width, frames.camera.height, 1, masks.roadway};
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    out.data[i] = masks.roadway[i] ? 1 : masks.ground[i] ? 2 : 0;
  }
  return out;
}

}  // namespace

void ReconstructOptions::validate() const {
  if (rounds < 0) {
    throw std::invalid_argument("rounds = " + std::to_string(rounds) + ", expected at least 0");
  }
  if (preset == Preset::kPaper && vehicles.method == VehicleMethod::kReprojection) {
    throw std::invalid_argument(
        "method: reprojection, must be joint, coplanar or flat with preset paper");
  }
  match.flow.validate();
  motion.validate();
  surface.validate();
  vehicles.fit.validate();
  vehicles.support.validate();
  paper.vehicles.weights.validate();
}

Reconstruction reconstruct(const Scene& scene, const std::vector<int>& frame_ids,
                           const ReconstructOptions& options, const Progress& progress) {
  options.validate();
  ReconstructOptions o = handed_down(options);
  if (o.preset == Preset::kPaper) return reconstruct_paper(scene, frame_ids, o, progress);
  if (frame_ids.size() == 1) return reconstruct_image(scene, frame_ids, o, progress);
  Timings timings;
  StageRunner run(timings, progress);

  LoadedFrames frames = run("load", 0.0, [&] { return stages::load(scene, frame_ids, o.load); });
  if (frames.box_sigma_px) o.vehicles.fit.noise.box.pixel_sigma = *frames.box_sigma_px;
  const SeenRoad seen = see_road(scene, frames, o, run);
  const PhotometricGround refined = run("ground", 0.8, [&] {
    return o.photometric ? stages::refine_photometrically(frames, seen.matches, seen.motion,
                                                          seen.ground, o.ground)
                         : PhotometricGround{seen.ground, seen.motion, nullptr, {}, {}, {}};
  });
  const ScaledRoad scaled =
      run("scale", 0.83, [&] { return stages::scale(frames, seen.matches, refined, o.scale); });
  const SurfacePlan plan = run("surface", 0.85, [&] {
    return stages::surface(frames, seen.matches, refined.motion, refined.ground, scaled.road,
                           o.surface);
  });
  PlacedVehicles vehicles = run("vehicles", 0.9, [&] {
    return stages::vehicles(frames, refined.motion, scaled, plan, o.vehicles);
  });
  const JudgedRoad judged = run("scale", 0.97, [&] {
    const RoadLayer layer = stages::road_layer(frames, seen.matches, refined,
                                               scaled.road.metres_per_baseline(), o.num_threads);
    return stages::judge(scaled, layer, vehicles, {o.scale.noise});
  });
  AssembledRoad road = run("surface", 0.98, [&] {
    return stages::assemble(frames, seen.matches, refined, scaled, plan, vehicles, judged,
                            o.vehicles.method, {o.num_threads, o.scale.noise});
  });
  stages::level_by_gravity(scene, &road.run, &road.surface);
  if (progress) progress("surface", 1.0);

  Reconstruction out = handed_out(frame_ids, o, frames, std::move(road));
  out.ground = std::move(vehicles.ground.under_detections);
  out.road_mask = road_mask_of(frames);
  describe_run(options, out.frame_ids, frames, refined, scaled, &out.run);
  put_georeference(scene, out.surface, &out.run);
  out.run.timings = timings;
  return out;
}

}  // namespace camber
