#include "scene_input.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <utility>

#include "camber/core/errors.h"
#include "crs.h"
#include "own_inputs.h"
#include "plugins/recording_plugin.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

/// The first option that only a film, images or a bag take; empty: none is given.
std::string camera_option(const App& app) {
  for (const char* name : {"--calib", "--camera", "--rectified", "--fx", "--fy", "--cx", "--cy",
                           "--fov", "--fov-sigma", "--height", "--height-sigma", "--rate",
                           "--no-telemetry", "--telemetry-offset"}) {
    if (app.count(name) > 0) return name;
  }
  return "";
}

void report(const OpenedScene& opened, const std::string& from, const fs::path& kept) {
  fmt::print(stderr, "camber: {}: {}; the scene is kept in {}\n", from,
             opened.found.empty() ? fmt::format("{} images", opened.scene.frames.size())
                                  : opened.found.front(),
             kept.string());
  if (!opened.telemetry.empty()) fmt::print(stderr, "camber: {}\n", opened.telemetry);
  if (!opened.camera_guessed) return;
  fmt::print(
      stderr,
      "camber: nothing is known of the camera: a field of view of {:.0f} degrees is guessed, "
      "its focal length to {:.0f} %; --fov or --calib make distances better known\n",
      kGuessedFovDeg, 100.0 * kGuessedFocalSigma);
}

}  // namespace

namespace {

constexpr char kSceneHelp[] =
    "scene manifest (scene.json) or its folder; or a film, a folder of images or a recording (ROS "
    "1, rosbag2, MCAP), of which a scene is made on the way";

void add_how_to_read(App& app, SceneInputArguments& a) {
  add_camera_options(app, a.camera, CameraSource::kBag);
  app.add_option("--rate", a.rate, "frames a second of images")->check(positive_number());
  add_telemetry_options(app, a.telemetry);
  add_confine_option(app, a.confine);
}

}  // namespace

void add_scene_input(App& app, SceneInputArguments& a) {
  app.add_option("scene", a.path, kSceneHelp)->required();
  add_how_to_read(app, a);
}

void add_scene_inputs(App& app, SceneInputArguments& a, std::vector<std::string>& paths) {
  app.add_option("scene", paths, kSceneHelp);
  add_how_to_read(app, a);
}

void add_calibrate_option(App& app, bool& no_calibrate) {
  app.add_flag("--no-calibrate", no_calibrate,
               "keep a camera that is guessed (--fov, or nothing given) as it is; by default the "
               "drive shows it, as far as it does");
}

SceneInput::SceneInput(const Command& command, const SceneInputArguments& arguments,
                       const fs::path& out) {
  OpenSceneOptions options;
  options.paths = scene_paths(arguments.confine);
  const InputKind kind = kind_of_input(arguments.path);
  if (out.empty()) throw UsageError("found an empty name, expected a folder for the result");
  // As deep as the folder that it becomes, so that the manifest's relative paths hold in both.
  fs::path folder = fs::weakly_canonical(fs::absolute(out));
  if (!folder.has_filename()) folder = folder.parent_path();
  kept_ = folder / "scene";
  if (kind == InputKind::kScene) {
    const std::string option = camera_option(*command.app);
    if (!option.empty()) {
      throw UsageError(fmt::format(
          "{}: {} is a scene, which states its camera itself; expected a film, images or a bag "
          "beside that option",
          option, arguments.path));
    }
    opened_ = open_scene(arguments.path, options, make_warning_sink(command.common));
    manifest_ = fs::absolute(arguments.path).lexically_normal();
    return;
  }
  arguments.camera.take(&options.own);
  if (arguments.rate > 0.0) options.own.times.rate = arguments.rate;
  options.own.telemetry = arguments.telemetry.take();
  if (kind == InputKind::kVideo) options.own.gnss.projection = project_to_map;
  options.own.camera.guess = true;
  options.own.validate();
  options.open_bag = [](const fs::path& bag) {
    return std::shared_ptr<BagReader>(open_any_bag(bag));
  };
  parent_ = std::make_unique<MadeFolder>(folder.parent_path());
  work_ = std::make_unique<MadeFolder>(
      folder.parent_path() / fmt::format(".{}.import-{}", folder.filename().string(), ::getpid()));
  imported_ = folder.parent_path() /
              fmt::format(".{}.import-{}", folder.filename().string(), ::getpid()) / "scene";
  manifest_ = kept_ / "scene.json";
  options.import_to = imported_;
  opened_ = open_scene(arguments.path, options, make_warning_sink(command.common));
  if (!command.common.quiet) report(opened_, arguments.path, out / "scene");
}

std::string SceneInput::kept_name(const std::string& file) const {
  if (imported_.empty() || file.rfind(imported_.string(), 0) != 0) return file;
  return kept_.string() + file.substr(imported_.string().size());
}

void SceneInput::recalibrate(Scene scene) {
  calibrated_ = std::move(scene);
  manifest_ = kept_ / "scene.json";
}

void SceneInput::keep_in(const fs::path& staging) {
  if (imported_.empty() && calibrated_) {
    fs::create_directories(staging / "scene");
    write_scene(*calibrated_, staging / "scene" / "scene.json");
  }
  if (imported_.empty()) return;
  if (calibrated_) write_scene(*calibrated_, imported_ / "scene.json");
  std::error_code error;
  fs::rename(imported_, staging / "scene", error);
  if (error) throw OutputError((kept_).string(), error.message());
  parent_->keep();
}

}  // namespace camber::tools
