#include "drive_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/core/hash.h"
#include "camber/core/protected_inputs.h"
#include "camber/export/trajectory.h"
#include "camber/scene/georeference.h"
#include "drive_progress.h"
#include "own_inputs.h"
#include "result_map.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

using nlohmann::json;

/// The place on the map as a track of points on the earth, where the frames have positions.
void write_gpx(const DriveResult& result, const DriveSurface& road, const fs::path& file) {
  const std::optional<GeoReference> map = georeference_of(road.run, file);
  if (!map) return;
  std::vector<StampedPose> poses;
  for (const DriveFrame& frame : result.document.frames) {
    if (!frame.world_from_camera) continue;
    poses.push_back({frame.id, frame.time_s, map->map_from_reference * *frame.world_from_camera});
  }
  write_file_atomically(file, encode_gpx(track_on_earth(poses, map->crs, true)));
}

}  // namespace

DriveOutcome run_drive_job(const Command& command, const DriveArguments& a) {
  DriveSceneOptions options;
  options.networks = choice_of(a.networks);
  SceneInput input(command, a.input, a.out);
  const Scene& scene = input.opened().scene;
  options.inputs = files_of(scene);
  options.inputs.emplace_back(a.input.path);
  for (const fs::path& file : files_of(options.networks)) options.inputs.push_back(file);
  protect_inputs(options.inputs);
  options.drive.window.seed = command.common.seed;
  options.drive.window.num_threads = command.common.threads;
  options.drive.window.load.use_masks = !a.no_masks;
  options.frames = a.frames;
  options.calibrates = !a.no_calibrate;
  options.pictures = !a.no_pictures;
  options.film = a.film;
  options.overwrite = a.overwrite;
  options.resume = a.resume;
  options.command = command.common.command_line;
  options.manifest = input.manifest();
  const fs::path& manifest = input.opened().manifest;
  options.manifest_hash =
      hash_file(fs::is_directory(manifest) ? manifest / "scene.json" : manifest);
  options.gpx = write_gpx;
  options.warn = make_warning_sink(command.common);
  if (!command.common.quiet) {
    options.notice = [](const std::string& text) {
      std::fprintf(stderr, "camber: %s\n", text.c_str());
    };
  }
  options.add_files = [&](const fs::path& folder, const Scene* calibrated) {
    if (calibrated) input.recalibrate(*calibrated);
    if (!input.is_kept()) return;
    std::error_code error;
    fs::remove_all(folder / "scene", error);  // an earlier run's
    input.keep_in(folder);
  };
  const std::size_t frames = select_frames(scene, a.frames).size();
  return drive_scene(scene, a.out, options, drive_progress(command.common, frames));
}

std::string describe_drive(const std::string& folder, const json& run) {
  const json& drive = run.at("drive");
  const double length = drive.at("length").is_number() ? drive.at("length").get<double>() : 0.0;
  const double sigma =
      drive.at("length_sigma").is_number() ? drive.at("length_sigma").get<double>() : 0.0;
  const auto rejected = drive.value("rejected_tracks", std::size_t{0});
  return fmt::format("{}: {} frames, {:.1f} {} +- {:.1f} %, {} cells of road, {} tracks{}", folder,
                     drive.at("frames").get<std::size_t>(), length,
                     run.value("metric", false) ? "m" : "units",
                     100.0 * sigma / std::max(length, 1e-9), drive.at("cells").get<std::size_t>(),
                     drive.at("tracks").get<std::size_t>(),
                     rejected > 0 ? fmt::format(", {} rejected", rejected) : "");
}

}  // namespace camber::tools
