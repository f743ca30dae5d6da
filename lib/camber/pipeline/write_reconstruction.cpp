#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

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
#include "camber/scene/surface_file.h"
#include "camber/scene/vehicle_table.h"

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

/// Writes the overlays, scene.png, bev.png and scene.glb; what draws with OpenGL comes first, since
/// it takes longest, on one thread.
/// @param report  called with the share that is done, on the calling thread
/// @return the overlays as JPEG by their file names, for the report
std::map<std::string, std::string> draw_pictures(const Scene& scene, Reconstruction* result,
                                                 const PictureContent& content,
                                                 const fs::path& folder, int num_threads,
                                                 const std::function<void(double)>& report) {
  RenderRecord record;
  std::vector<std::string> names, jpegs(result->frame_ids.size());
  std::vector<std::function<void()>> pictures = {
      [&] { write_png(render_scene_picture(content, {}, &record), folder / "scene.png"); },
      [&] { write_png(render_bev_picture(content), folder / "bev.png"); }};
  for (std::size_t k = 0; k < jpegs.size(); ++k) {
    char name[40];
    std::snprintf(name, sizeof name, "overlay_%06d.png", result->frame_ids[k]);
    names.emplace_back(name);
    pictures.emplace_back([&, k] {
      const Image overlay = overlay_of(scene, *result, k);
      write_png(overlay, folder / names[k]);
      jpegs[k] = encode_jpeg(overlay);
    });
  }
  pictures.emplace_back([&] { write_glb(content, folder / "scene.glb"); });

  // As OffscreenWindow does, but while no other thread reads the environment.
  ::setenv("EGL_LOG_LEVEL", "fatal", 0);
  const std::thread::id caller = std::this_thread::get_id();
  std::atomic<std::size_t> done{0};
  parallel_for(pictures.size(), num_threads, [&](std::size_t i) {
    pictures[i]();
    const auto share = static_cast<double>(++done) / static_cast<double>(pictures.size());
    if (std::this_thread::get_id() == caller) report(share);
  });
  report(1.0);
  result->run.gl_backend = record.backend + ", " + record.renderer;
  std::map<std::string, std::string> out;
  for (std::size_t k = 0; k < jpegs.size(); ++k) out[names[k]] = std::move(jpegs[k]);
  return out;
}

/// Of the frames whose time is known, s, by their ids.
std::map<int, double> times_of(const Scene& scene, const std::vector<int>& frame_ids) {
  std::map<int, double> out;
  for (const int id : frame_ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (!frame || (!frame->time_s && !scene.frame_rate)) continue;
    out[id] = time_of(*frame, scene.frame_rate.value_or(1.0));
  }
  return out;
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
  ReportContent page;
  if (options.pictures) {
    report("render", 0.0);
    const StageTimer timer(timings, "render");
    page.overlay_jpegs = draw_pictures(scene, &result, content, staging, options.num_threads,
                                       [&](double share) { report("render", share); });
  }

  result.run.extra["libraries"] = library_versions();
  std::string summary;
  nlohmann::json metrics_json;
  report("write", 0.0);
  {
    const StageTimer timer(timings, "write");
    write_cloud(result.cloud, staging / "road.ply");
    if (!result.road_mask.empty()) write_png(result.road_mask, staging / "road_mask.png");
    write_surface(result.surface, staging / "surface.json");
    write_json(to_json(result.vehicles), staging / "vehicles.json");
    write_file_atomically(staging / "vehicles.csv",
                          vehicles_csv(result.vehicles, times_of(scene, result.frame_ids)));
    if (scene.truth) {
      const SceneMetrics metrics =
          evaluate_scene(scene, result.surface, result.vehicles, result.run);
      metrics_json = to_json(metrics);
      write_json(metrics_json, staging / "metrics.json");
      summary = describe(metrics);
      if (!result.surface.metric) {
        summary = "up to scale: units are taken for metres in what follows\n" + summary;
      }
    }
  }
  if (options.pictures) {
    page.picture = content;
    page.picture_folder = staging;
    page.metrics = metrics_json;
    // It has the times of all stages but its own, which run.json has.
    const StageTimer timer(timings, "report");
    write_report(page, staging / "report.html");
  }
  write_json(to_json(result.run), staging / "run.json");
  if (options.add_files) options.add_files(staging);
  out.commit();
  report("write", 1.0);
  return summary;
}

}  // namespace camber
