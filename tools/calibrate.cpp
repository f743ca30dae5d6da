// camber calibrate: the camera from its own drive.

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/calibrate/write_calibration.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/made_folder.h"
#include "camber/core/version.h"
#include "camber/import/open_scene.h"
#include "camber/pipeline/find_vehicles.h"
#include "camber/scene/marking_presets.h"
#include "camera_arguments.h"
#include "command.h"
#include "crs.h"
#include "gnss_arguments.h"
#include "own_inputs.h"
#include "plugins/recording_plugin.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  std::string scene, out, scene_out, frames, markings;
  NetworkChoice networks;
  CameraArguments camera;
  TelemetryArguments telemetry;
  double rate = 0.0;
  bool json = false, confine = false, overwrite = false;
};

json result_json(const Command& command, const Arguments& a, const DriveCalibration& c) {
  json out = to_json(c);
  out["version"] = kVersion;
  out["seed"] = command.common.seed;
  out["options"] = {
      {"scene", a.scene},
      {"frames", a.frames.empty() ? "all" : a.frames},
      {"rate", a.rate > 0.0 ? json(a.rate) : json()},
      {"markings", a.markings.empty() ? json() : json(a.markings)},
      {"detector", a.networks.detector.empty() ? json() : json(a.networks.detector)},
      {"keypoints", a.networks.keypoints.empty() ? json() : json(a.networks.keypoints)}};
  add_telemetry_json(a.telemetry, &out["options"]);
  out["timings_ms"] = json::object();
  for (const auto& [stage, ms] : c.timings.stages()) out["timings_ms"][stage] = ms;
  return out;
}

void print_text(const Arguments& a, const DriveCalibration& c) {
  const DriveLens& lens = c.lens.lens;
  constexpr double kDegrees = 57.29577951308232;
  const double half = 0.5 * lens.width / lens.f;
  fmt::print("{}: focal length {:.1f} px +- {:.1f} % (field of view {:.1f} degrees), by {}\n",
             a.out, lens.f, 100.0 * c.lens.sigma(0), 2.0 * kDegrees * std::atan(half),
             c.focal_decided_by);
  fmt::print("  principal point {:.1f} +- {:.1f}, {:.1f} +- {:.1f} px; k1 {:.3f} +- {:.3f}\n",
             lens.cx, c.lens.sigma(1), lens.cy, c.lens.sigma(2), lens.k1, c.lens.sigma(3));
  const auto angle = [&](const char* name, const std::optional<MountingNumber>& value) {
    if (!value) return;
    fmt::print("  {} {:.2f} +- {:.2f} degrees\n", name, kDegrees * value->value,
               kDegrees * value->sigma);
  };
  angle("pitch", c.mounting.pitch);
  angle("yaw", c.mounting.yaw);
  angle("roll", c.mounting.roll);
  if (const auto& height = c.mounting.height) {
    fmt::print("  {:.3f} +- {:.3f} m above the road, by {}\n", height->value, height->sigma,
               c.mounting.height_by);
  }
  for (const std::string& note : c.notes) fmt::print("  {}\n", note);
}

/// The scene, or what is imported on the way into `folder`.
OpenedScene open(const Command& command, const Arguments& a, const fs::path& folder) {
  OpenSceneOptions options;
  options.paths = scene_paths(a.confine);
  if (kind_of_input(a.scene) == InputKind::kScene) {
    for (const char* name :
         {"--height", "--height-sigma", "--rate", "--no-telemetry", "--telemetry-offset"}) {
      if (command.app->count(name) == 0) continue;
      throw UsageError(fmt::format(
          "{}: {} is a scene, which states it itself; expected a film, images or a bag beside "
          "that option",
          name, a.scene));
    }
  } else {
    a.camera.take(&options.own);
    if (a.rate > 0.0) options.own.times.rate = a.rate;
    options.own.telemetry = a.telemetry.take();
    if (kind_of_input(a.scene) == InputKind::kVideo) options.own.gnss.projection = project_to_map;
    options.own.camera.guess = true;
    options.own.validate();
    options.open_bag = [](const fs::path& bag) {
      return std::shared_ptr<BagReader>(open_any_bag(bag));
    };
    options.import_to = folder;
  }
  return open_scene(a.scene, options, make_warning_sink(command.common));
}

int run(const Command& command, const Arguments& a) {
  const Progress progress = make_progress(command.common);
  check_output_file(a.out);
  std::unique_ptr<AtomicFolder> scene_folder;
  std::unique_ptr<MadeFolder> hidden;
  fs::path import_to;
  if (!a.scene_out.empty()) {
    scene_folder =
        std::make_unique<AtomicFolder>(a.scene_out, a.overwrite, std::vector<fs::path>{a.scene});
    import_to = scene_folder->staging();
  } else {
    fs::path beside = fs::weakly_canonical(fs::absolute(a.out)).parent_path();
    import_to = beside / fmt::format(".calibrate.import-{}", ::getpid());
    if (kind_of_input(a.scene) != InputKind::kScene)
      hidden = std::make_unique<MadeFolder>(import_to);
  }
  OpenedScene opened = open(command, a, import_to);
  if (!a.markings.empty()) opened.scene.markings_m = *marking_preset(a.markings);
  if (!opened.telemetry.empty() && !command.common.quiet) {
    fmt::print(stderr, "camber: {}\n", opened.telemetry);
  }
  std::vector<fs::path> inputs = files_of(opened.scene);
  for (const fs::path& file : files_of(a.networks)) inputs.push_back(file);
  refuse_own_inputs({a.out}, inputs);
  CalibrateOptions options;
  options.seed = command.common.seed;
  options.num_threads = command.common.threads;
  options.find_vehicles = vehicle_finder(a.networks, command.common.threads);
  const DriveCalibration result =
      calibrate_drive(opened.scene, select_frames(opened.scene, a.frames), options, {}, progress);
  const std::string yaml = calibration_yaml(result, a.scene);
  if (scene_folder) {
    write_scene(calibrated_scene(opened.scene, result), scene_folder->staging() / "scene.json");
    scene_folder->commit();
  }
  write_file_atomically(a.out, yaml);
  if (a.json) {
    std::printf("%s\n", result_json(command, a, result).dump(2).c_str());
  } else if (!command.common.quiet) {
    print_text(a, result);
  }
  return 0;
}

}  // namespace

void register_calibrate(App& root) {
  Command* command = add_command(
      root, "calibrate",
      "The camera from its own drive: focal length, principal point, radial distortion and "
      "mounting by the pictures alone, and the height above the road by speeds or positions of "
      "the frames, the sizes of vehicles or broken lines of known sizes, each with its standard "
      "deviation. A calibration that the scene has is not used. What is known before is that of "
      "vehicles and dash cameras: a horizontal field of view of 35 to 130 degrees, square pixels, "
      "no skew, the principal point near the middle. Turns show the focal length; on a straight "
      "drive the proportions of vehicles do, and, where the height is given or known otherwise, "
      "speeds and broken lines. The sources are compared before they are joined, and listed.",
      "  camber calibrate drive.mp4 --out camera.yaml\n"
      "  camber calibrate frames/ --out camera.yaml --scene calibrated --height 1.4\n"
      "  camber calibrate drive.mp4 --markings de-landstrasse --out camera.yaml\n"
      "  camber reconstruct calibrated --out out/result");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  app.add_option("scene", a.scene,
                 "scene manifest (scene.json) or its folder; or a film, a folder of images or a "
                 "recording (ROS 1, rosbag2, MCAP)")
      ->required();
  app.add_option("--out", a.out, "calibration, OpenCV's YAML, with the standard deviations beside")
      ->output_file()
      ->required();
  app.add_option("--scene", a.scene_out, "folder of the scene with that camera")->output_folder();
  app.add_option("--frames", a.frames,
                 "frame ids: 48:200 (both ends), 0:400:2 or all; default: all")
      ->no_name();
  add_height_options(app, a.camera);
  app.add_option("--rate", a.rate, "frames a second of images")->check(positive_number());
  add_telemetry_options(app, a.telemetry);
  app.add_option("--markings", a.markings,
                 "sizes of the road's broken lines (docs/formats.md); default: those of the scene")
      ->check(is_member(marking_preset_names()));
  app.add_option("--detector", a.networks.detector,
                 "the network that finds vehicles: shipped, an ONNX file, or none; default: the "
                 "boxes of the scene, else shipped");
  app.add_option("--keypoints", a.networks.keypoints,
                 "the network that finds their keypoints: shipped, an ONNX file, or none; default: "
                 "those of the scene, else shipped");
  add_confine_option(app, a.confine);
  app.add_flag("--overwrite", a.overwrite, "replace a folder of --scene that is not empty");
  app.add_flag("--json", a.json, "print the result as JSON to stdout");
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
