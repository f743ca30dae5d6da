#include "camber/pipeline/reconstruct_image.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "camber/pipeline/run_details.h"
#include "camber/pipeline/stage_runner.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/pipeline/stages/level.h"
#include "camber/pipeline/stages/marked_ground.h"
#include "camber/road/local_plane.h"
#include "camber/scene/georeference.h"

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

nlohmann::json vector_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

/// A marking's place and the plane of the road under it.
nlohmann::json marking_json(const SeenMarking& marking, const RoadPosterior& road,
                            const PinholeCamera& camera) {
  const double rho = road.inverse_depth(marking.pixel);
  const Eigen::Vector3d center = camera.ray(marking.pixel) / rho;
  const double variance = road.covariance(
      road.of_inverse_depths({marking.pixel}, Eigen::MatrixXd::Identity(1, 1)))(0, 0);
  nlohmann::json out = {
      {"kind", to_string(marking.kind)},
      {"pixel", {marking.pixel.x(), marking.pixel.y()}},
      {"ends",
       {{marking.near_end.x(), marking.near_end.y()}, {marking.far_end.x(), marking.far_end.y()}}},
      {"center", vector_json(center)},
      {"distance", center.norm()},
      {"sigma_distance", center.norm() * std::sqrt(variance) / rho},
      {"beside_another", marking.beside}};
  if (marking.kind == MarkingKind::kCrossing) out["stripes"] = marking.strokes;
  LocalPlaneOptions footprint;
  footprint.length = marking.length;
  const LocalPlane local = fit_local_plane(road, camera, marking.near_end, footprint);
  if (local.status != Status::kFailed) {
    const Eigen::Matrix3d& covariance = local.plane.covariance;
    out["plane"] = {{"normal", vector_json(local.plane.plane.normal)},
                    {"offset", local.plane.plane.offset},
                    {"sigma_along_deg", std::sqrt(covariance(1, 1)) * kDegrees},
                    {"sigma_across_deg", std::sqrt(covariance(0, 0)) * kDegrees}};
  }
  return out;
}

nlohmann::json markings_json(const MarkedRoad& marked, const ScaledRoad& scaled,
                             const PinholeCamera& camera) {
  nlohmann::json found = nlohmann::json::array();
  for (const SeenMarking& m : marked.markings) {
    found.push_back(marking_json(m, scaled.road, camera));
  }
  return {{"status", "used"},
          {"reason", ""},
          {"dashes", marked.dashes},
          {"crossings", marked.crossings},
          {"lines", marked.lines},
          {"farthest", marked.farthest},
          {"misfit", marked.misfit},
          {"evidence", marked.evidence},
          {"evidence_of_other", marked.evidence_of_other},
          {"found", std::move(found)}};
}

void describe(const ReconstructOptions& options, const std::vector<int>& frame_ids,
              const LoadedFrames& frames, const MarkedGround& marked, const ScaledRoad& scaled,
              RunDocument* document) {
  document->seed = options.seed;
  *document->options = {{"preset", to_string(options.preset)},
                        {"method", to_string(options.vehicles.method)},
                        {"frames", frame_ids},
                        {"use_masks", options.load.use_masks},
                        {"keypoint_set", static_cast<int>(options.vehicles.fit.keypoint_set)}};
  nlohmann::json& extra = *document->extra;
  extra["reference_frame"] = frames.frames.front().id;
  extra["markings"] = markings_json(marked.road, scaled, frames.camera);
  extra["scale_from"] = {
      {"source",
       frames.known.camera_height ? "markings, and camera height over the ego plane" : "markings"},
      {"sigma_road_shape", marked.ground.ground.ego.relative_sigma}};
  extra["road_from"] = "markings";
}

}  // namespace

Reconstruction reconstruct_image(const Scene& scene, const std::vector<int>& frame_ids,
                                 const ReconstructOptions& options, const Progress& progress) {
  ReconstructOptions o = options;
  o.load.single_image = true;
  Timings timings;
  const StageRunner run(timings, progress);
  LoadedFrames frames = run("load", 0.0, [&] { return stages::load(scene, frame_ids, o.load); });
  if (frames.box_sigma_px) o.vehicles.fit.noise.box.pixel_sigma = *frames.box_sigma_px;
  const MarkedGround marked =
      run("ground", 0.1, [&] { return stages::marked_ground(frames, o.scale); });
  const ScaledRoad scaled =
      run("scale", 0.5, [&] { return stages::scale_by_markings(frames, marked, o.scale); });
  const SurfacePlan plan = run("surface", 0.6, [&] {
    return stages::surface(frames, marked.pixels, marked.ground.motion, marked.ground.ground,
                           scaled.road, o.surface);
  });
  PlacedVehicles vehicles = run("vehicles", 0.7, [&] {
    return stages::vehicles(frames, marked.ground.motion, scaled, plan, o.vehicles);
  });
  const JudgedRoad judged = run("scale", 0.97, [&] {
    return stages::judge(scaled, std::nullopt, vehicles, {o.scale.noise});
  });
  AssembledRoad road = run("surface", 0.98, [&] {
    return stages::assemble(frames, marked.pixels, marked.ground, scaled, plan, vehicles, judged,
                            o.vehicles.method, {o.num_threads, o.scale.noise});
  });
  stages::level_by_gravity(scene, &road.run, &road.surface);
  if (progress) progress("surface", 1.0);

  Reconstruction out = handed_out(frame_ids, o, frames, std::move(road));
  out.ground = std::move(vehicles.ground.under_detections);
  describe(o, out.frame_ids, frames, marked, scaled, &out.run);
  put_georeference(scene, out.surface, &out.run);
  out.run.timings = timings;
  return out;
}

}  // namespace camber
