// camber drive: a whole drive of one moving camera to a metric trajectory, the road and vehicles.

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/memory.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/drive/detect_drive.h"
#include "camber/drive/write_drive.h"
#include "camber/scene/results.h"
#include "command.h"
#include "network_arguments.h"
#include "own_inputs.h"
#include "scene_input.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

struct Arguments {
  SceneInputArguments input;
  NetworkArguments networks;
  std::string out, frames;
  bool no_masks = false, overwrite = false, resume = false, json = false;
};

/// What has to be equal for a part of a drive to be gone on with.
nlohmann::json header_of(const OpenedScene& opened, const std::vector<int>& ids,
                         const Command& command, const Arguments& a) {
  const fs::path& manifest = opened.manifest;
  return {{"version", kVersion},
          {"scene", hash_file(fs::is_directory(manifest) ? manifest / "scene.json" : manifest)},
          {"frames", ids},
          {"no_masks", a.no_masks},
          {"networks",
           {a.networks.detector, a.networks.detector_config, a.networks.keypoints,
            a.networks.keypoints_config}},
          {"seed", command.common.seed}};
}

nlohmann::json run_json(const Command& command, const Arguments& a, const SceneInput& input,
                        bool complete) {
  return {
      {"version", kVersion},
      {"seed", command.common.seed},
      {"complete", complete},
      {"command", command.common.command_line},
      {"scene", input.manifest().string()},
      {"options", {{"frames", a.frames.empty() ? "all" : a.frames}, {"use_masks", !a.no_masks}}},
      {"frames_given", input.opened().scene.frames.size()}};
}

/// What an earlier drive left; nothing else is touched.
void remove_earlier(const fs::path& folder) {
  std::error_code none;
  for (const char* name : {"drive.json", "trajectory.tum", "poses.txt", "vehicles.json",
                           "tracks.json", "tracks.csv", "strip", "surface", "windows.log"}) {
    fs::remove_all(folder / name, none);
  }
}

int run(const Command& command, Arguments& a) {
  const Progress progress = make_progress(command.common);
  SceneInput input(command, a.input, a.out);
  Scene scene = input.opened().scene;
  std::vector<fs::path> inputs = files_of(scene);
  inputs.emplace_back(a.input.path);
  if (!a.networks.segmenter.empty()) {
    throw UsageError(
        "--segmenter: the labels of a whole drive are not computed on the way; camber detect "
        "--segmenter writes a scene with them");
  }
  DetectFramesOptions networks = detect_options(a.networks, command.common.threads);
  const FindKeypointsOptions keypoints = keypoint_options(a.networks, command.common.threads);
  for (const fs::path& file : files_of(networks.networks)) inputs.push_back(file);
  for (const fs::path& file : files_of(keypoints)) inputs.push_back(file);
  protect_inputs(inputs);
  const std::vector<int> ids = select_frames(scene, a.frames);
  const fs::path folder = a.out;
  const bool goes_on = a.resume && fs::exists(folder / "windows.log");
  if (!goes_on) check_output_folder(folder, a.overwrite, inputs);
  DriveOptions options;
  options.window.seed = command.common.seed;
  options.window.num_threads = command.common.threads;
  options.window.load.use_masks = !a.no_masks;
  keep_freed_memory();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  if (!goes_on) remove_earlier(folder);
  write_json(run_json(command, a, input, false), folder / "run.json");
  const bool by_shipped =
      a.networks.detector.empty() && !has_boxes(scene) && has_images(scene, ids);
  if (by_shipped) networks.networks.detector = kShippedNetwork;
  Timings network_time;
  StageTimer network_timer(network_time, "networks");
  const DriveNetworks seen =
      detect_drive(&scene, ids, networks, keypoints, progress, make_warning_sink(command.common));
  network_timer.stop();
  if (by_shipped && !command.common.quiet) {
    std::fprintf(stderr,
                 "camber: the scene has no boxes: vehicles are what the shipped detector finds "
                 "(--detector none leaves them out)\n");
  }
  DriveResult result;
  {
    WindowLog log(folder / "windows.log", header_of(input.opened(), ids, command, a), goes_on);
    result = run_drive(scene, ids, options, &log, progress);
  }
  nlohmann::json document = run_json(command, a, input, true);
  document["resumed"] = goes_on;
  if (!networks.networks.empty() || seen.keypoints) {
    document["networks"] = network_json(seen.view, seen.keypoints);
    result.timings.add("networks", network_time.stages().front().second);
  }
  for (const auto& [stage, ms] : result.timings.stages()) document["timings_ms"][stage] = ms;
  nlohmann::json warnings = nlohmann::json::array();
  std::size_t held = 0;
  for (const TrajectoryPose& pose : result.trajectory.poses) held += pose.measured ? 0 : 1;
  if (held > 0) {
    warnings.push_back({{"code", "poses_held"},
                        {"text", fmt::format("of {} frames no picture shows how the camera moved: "
                                             "they are bridged",
                                             held)}});
  }
  document["warnings"] = warnings;
  document["metric"] = result.trajectory.metric;
  nlohmann::json windows = nlohmann::json::array();
  for (const auto& w : result.trajectory.scales) {
    windows.push_back(
        {{"reference", w.reference}, {"residual_sigma", w.residual_sigma}, {"weight", w.weight}});
  }
  document["windows"] = std::move(windows);
  if (input.opened().kind != InputKind::kScene) {
    fs::remove_all(folder / "scene", error);  // an earlier run's
    input.keep_in(folder);
  }
  write_drive(result, options.strip, document, folder);
  fs::remove(folder / "windows.log", error);
  for (const auto& warning : warnings) {
    std::fprintf(stderr, "camber: warning: %s\n", warning.at("text").get<std::string>().c_str());
  }
  if (a.json) {
    std::printf("%s\n", document.dump(2).c_str());
    return 0;
  }
  if (command.common.quiet) return 0;
  const Trajectory::Stretch& whole = result.trajectory.whole;
  std::printf("%s: %zu frames, %.1f %s +- %.1f %%, %zu cells of road, %zu tracks\n", a.out.c_str(),
              result.document.frames.size(), whole.length, result.trajectory.metric ? "m" : "units",
              100.0 * whole.sigma() / std::max(whole.length, 1e-9), result.strip.cells.size(),
              result.tracks.tracks.size());
  return 0;
}

}  // namespace

void register_drive(App& root) {
  Command* command = add_command(
      root, "drive",
      "Turns a whole drive of one moving camera into a metric trajectory, the road along it and "
      "the vehicles on it as tracks: frames are read one after the other, windows of a few of them "
      "go through the stages of reconstruct, and all windows together give the drive. An "
      "interrupted run leaves what it measured; --resume goes on from there.",
      "  camber drive kitti/scene.json --out out/drive\n"
      "  camber drive drive.mp4 --height 1.3 --fov 70 --out out/drive\n"
      "  camber drive kitti/scene.json --frames 0:200 --out out/drive --resume");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  add_scene_input(app, a.input);
  add_network_options(app, a.networks);
  app.add_option("--frames", a.frames,
                 "frame ids: 48:200 (both ends), 0:400:2 or all; default: all")
      ->no_name();
  app.add_flag("--no-masks", a.no_masks,
               "do not read segmentations and road masks: find the road by geometry");
  app.add_option("--out", a.out, "result folder; an earlier result there is replaced")
      ->output_folder()
      ->required();
  app.add_flag("--resume", a.resume,
               "go on with the part that an interrupted run of the same inputs left in --out");
  app.add_flag("--overwrite", a.overwrite, "replace a folder that is no Camber result");
  app.add_flag("--json", a.json, "print run.json to stdout");
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
