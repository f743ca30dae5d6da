#include "camber/pipeline/reconstruct_paper.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "camber/core/errors.h"
#include "camber/pipeline/run_details.h"
#include "camber/pipeline/stages/find_road.h"
#include "camber/pipeline/stages/level.h"
#include "camber/pipeline/stages/paper_assemble.h"
#include "camber/scene/georeference.h"

namespace camber {
namespace {

/// A single image: no points; the plane under the camera is the scene's, or a level one at the
/// camera's height.
FoundRoad single_image(LoadedFrames frames, const ReconstructOptions& o) {
  const SceneFrame& frame = frames.frames.front();
  if (!frame.ego_plane && !frames.known.camera_height) {
    throw NoAnswerError(
        "one image has no parallax: it needs camera.height_above_road, or frames[].ego_plane");
  }
  FoundRoad out;
  out.motion.status = Status::kOk;
  out.motion.frame_from_reference = {SE3()};
  EgoPlane& ego = out.ground.ego;
  const SupportPlane support = frame.ego_plane
                                   ? ego_support(*frame.ego_plane, o.vehicles.support)
                                   : level_support(*frames.known.camera_height, o.vehicles.support);
  ego.plane = support.plane;
  ego.height = support.plane.plane.offset;
  ego.status = Status::kWeak;
  ego.reason = frame.ego_plane ? "given" : "level, at the camera's height";
  out.frames = std::move(frames);
  return out;
}

std::vector<TrackFrame> views_of(const LoadedFrames& frames, const MotionEstimate& motion,
                                 const PaperGround& ground, const ReconstructOptions& o) {
  std::vector<TrackFrame> out;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const SceneFrame& frame = frames.frames[k];
    TrackFrame view;
    view.world_from_camera = metric_pose(motion, k, ground.metres_per_baseline).inverse();
    view.time_s = time_of(frame, frames.frame_rate);
    view.detections = frame.vehicles;
    view.supports = stages::choose_supports(
        frames.camera, frame.vehicles,
        stages::ground_of_frame(ground, frames, motion, k, o.paper.ground, o.vehicles.support),
        frames.known.camera_height, o.vehicles);
    out.push_back(std::move(view));
  }
  return out;
}

void describe(const ReconstructOptions& options, const std::vector<int>& frame_ids,
              const LoadedFrames& frames, const MotionEstimate& motion, RunDocument* document) {
  document->seed = options.seed;
  *document->options = {{"preset", to_string(options.preset)},
                        {"paper_terms", paper::to_string(options.paper.vehicles.terms)},
                        {"paper_scale", to_string(options.paper.ground.scale)},
                        {"method", to_string(options.vehicles.method)},
                        {"frames", frame_ids},
                        {"rounds", options.rounds},
                        {"use_masks", options.load.use_masks},
                        {"keypoint_set", static_cast<int>(options.vehicles.fit.keypoint_set)}};
  nlohmann::json& extra = *document->extra;
  extra["reference_frame"] = frames.frames[frames.reference].id;
  extra["motion"] = {{"pixel_sigma", motion.pixel_sigma},
                     {"inlier_ratio", motion.inlier_ratio},
                     {"known_poses", motion.metres_per_baseline.has_value()}};
  extra["road_from"] = frames.has_masks() ? "mask" : "geometry";
}

}  // namespace

Reconstruction reconstruct_paper(const Scene& scene, const std::vector<int>& frame_ids,
                                 const ReconstructOptions& o, const Progress& progress) {
  Timings timings;
  const StageRunner run(timings, progress);
  stages::LoadOptions load = o.load;
  load.single_image = true;
  LoadedFrames loaded = run("load", 0.0, [&] { return stages::load(scene, frame_ids, load); });
  FoundRoad seen = loaded.size() == 1
                       ? single_image(std::move(loaded), o)
                       : stages::find_road(scene, std::move(loaded),
                                           {o.rounds, o.match, o.motion, o.ground}, run);
  LoadedFrames& frames = seen.frames;
  const PaperGround ground = run("surface", 0.85, [&] {
    return stages::paper_ground(frames, seen.matches, seen.motion, seen.ground, o.paper.ground);
  });
  const PlacedVehicles vehicles = run("vehicles", 0.9, [&] {
    return o.vehicles.enabled ? stages::place_paper_vehicles(
                                    frames.camera, views_of(frames, seen.motion, ground, o),
                                    o.vehicles, o.paper.vehicles)
                              : PlacedVehicles();
  });
  AssembledRoad road = run("surface", 0.98, [&] {
    return stages::assemble_paper(frames, seen.matches, seen.motion, seen.ground.seen, ground,
                                  vehicles, o.vehicles.method);
  });
  stages::level_by_gravity(scene, &road.run, &road.surface);
  if (progress) progress("surface", 1.0);

  Reconstruction out = handed_out(frame_ids, o, frames, std::move(road));
  out.vehicles.paper_terms = paper::to_string(o.paper.vehicles.terms);
  describe(o, out.frame_ids, frames, seen.motion, &out.run);
  put_georeference(scene, out.surface, &out.run);
  out.run.timings = timings;
  return out;
}

}  // namespace camber
