#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/threads.h"
#include "camber/evaluate/metrics.h"
#include "camber/image/image_io.h"
#include "camber/image/video.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/render/gltf.h"
#include "camber/render/overlay.h"
#include "camber/render/pictures.h"
#include "camber/render/report.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Without vehicles the picture of a frame shows the road: patches with their grade, and metres.
void show_road(const Reconstruction& result, int frame, OverlayRoad* road,
               OverlayOptions* options) {
  for (const RunDocument::CameraPose& camera : result.run.cameras) {
    if (camera.id != frame) continue;
    road->surface = &result.surface;
    road->reference_from_camera = camera.reference_from_camera;
    options->show_patches = options->show_grade = options->show_grid = true;
  }
}

/// The picture of a frame, by its index, with what was found in it.
Image overlay_of(const Scene& scene, const Reconstruction& result, std::size_t k) {
  VehicleFrame none;
  none.id = result.frame_ids[k];
  const VehicleFrame& vehicles =
      k < result.vehicles.frames.size() ? result.vehicles.frames[k] : none;
  OverlayOptions options;
  options.metric = result.vehicles.metric;
  options.numbers = VehicleNumbers(result.vehicles);
  OverlayRoad road;
  if (vehicles.vehicles.empty()) show_road(result, result.frame_ids[k], &road, &options);
  return draw_overlay(result.images[k], scene.camera, vehicles, options, road);
}

}  // namespace

std::string write_reconstruction(const Scene& scene, Reconstruction& result, const fs::path& folder,
                                 const WriteReconstructionOptions& options,
                                 const Progress& progress) {
  const auto report = [&](const std::string& stage, double share) {
    if (progress) progress(stage, share);
  };
  std::vector<fs::path> inputs = options.inputs;
  for (const SceneFrame& frame : scene.frames) {  // also what this run did not read
    inputs.insert(inputs.end(), {image_file_of(frame.image), frame.segmentation, frame.road_mask});
  }
  inputs.erase(std::remove(inputs.begin(), inputs.end(), fs::path()), inputs.end());
  AtomicFolder out(folder, options.overwrite, inputs);
  const fs::path& staging = out.staging();
  Timings& timings = result.run.timings;

  PictureContent content;
  content.cloud = &result.cloud;
  content.surface = &result.surface;
  content.vehicles = &result.vehicles;
  content.run = &result.run;
  content.camera = &scene.camera;
  content.truth = scene.truth ? &*scene.truth : nullptr;
  content.frame = result.reference_frame;
  content.title = scene.name;
  if (options.pictures) {
    report("render", 0.0);
    const StageTimer timer(timings, "render");
    parallel_for(result.frame_ids.size(), options.num_threads, [&](std::size_t k) {
      char name[40];
      std::snprintf(name, sizeof name, "overlay_%06d.png", result.frame_ids[k]);
      write_png(overlay_of(scene, result, k), staging / name);
    });
    report("render", 0.3);
    // VTK draws on one thread.
    RenderRecord record;
    const Image drawn[] = {render_scene_picture(content, {}, &record), render_bev_picture(content)};
    result.run.gl_backend = record.backend + ", " + record.renderer;
    report("render", 0.8);
    const char* const names[] = {"scene.png", "bev.png"};
    parallel_for(2, options.num_threads,
                 [&](std::size_t i) { write_png(drawn[i], staging / names[i]); });
    report("render", 0.9);
    write_glb(content, staging / "scene.glb");
    report("render", 1.0);
  }

  result.run.extra["libraries"] = library_versions();
  std::string summary;
  nlohmann::json metrics_json;
  report("write", 0.0);
  {
    const StageTimer timer(timings, "write");
    write_cloud(result.cloud, staging / "road.ply");
    if (!result.road_mask.empty()) write_png(result.road_mask, staging / "road_mask.png");
    write_json(to_json(result.surface), staging / "surface.json");
    write_json(to_json(result.vehicles), staging / "vehicles.json");
    if (scene.truth) {
      const SceneMetrics metrics =
          evaluate_scene(scene, result.surface, result.vehicles, result.run);
      metrics_json = to_json(metrics);
      write_json(metrics_json, staging / "metrics.json");
      summary = describe(metrics);
    }
  }
  if (options.pictures) {
    ReportContent page;
    page.picture = content;
    page.picture_folder = staging;
    page.metrics = metrics_json;
    // It has the times of all stages but its own, which run.json has.
    const StageTimer timer(timings, "report");
    write_report(page, staging / "report.html");
  }
  write_json(to_json(result.run), staging / "run.json");
  out.commit();
  report("write", 1.0);
  return summary;
}

}  // namespace camber
