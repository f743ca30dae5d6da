// camber detect: boxes, road masks and keypoints of a scene's frames by networks.

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/made_folder.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/pipeline/write_detected_scene.h"
#include "command.h"
#include "import_output.h"
#include "network_arguments.h"
#include "own_inputs.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  std::string scene, out, frames;
  NetworkArguments networks;
  bool json = false;
  bool confine = false;
};

void print_json(const Command& command, const Arguments& a, const NetworkView& view,
                const std::optional<NetworkUse>& keypoints, const fs::path& manifest,
                const Timings& timings) {
  json frames = json::array();
  std::vector<int> ids;
  for (const auto& [id, vehicles] : view.vehicles) ids.push_back(id);
  if (ids.empty()) {
    for (const auto& [id, labels] : view.labels) ids.push_back(id);
  }
  for (const int id : ids) {
    const auto found = view.vehicles.find(id);
    frames.push_back(
        {{"id", id},
         {"vehicles", found == view.vehicles.end() ? json() : json(found->second.size())},
         {"mask", view.labels.count(id) > 0}});
  }
  json out = {{"version", kVersion},
              {"seed", command.common.seed},
              {"options",
               {{"scene", a.scene},
                {"frames", a.frames},
                {"detector", a.networks.choice.detector},
                {"detector_config", a.networks.choice.detector_config},
                {"segmenter", a.networks.choice.segmenter},
                {"segmenter_config", a.networks.choice.segmenter_config},
                {"keypoints", a.networks.choice.keypoints},
                {"keypoints_config", a.networks.choice.keypoints_config}}},
              {"scene", manifest.string()},
              {"networks", network_json(view, keypoints)},
              {"frames", std::move(frames)},
              {"timings_ms", json::object()}};
  for (const auto& [stage, ms] : timings.stages()) out["timings_ms"][stage] = ms;
  std::printf("%s\n", out.dump(2, ' ', false, json::error_handler_t::replace).c_str());
}

int run(const Command& command, const Arguments& a) {
  const NetworkChoice choice = choice_of(a.networks);
  const DetectFramesOptions options = detect_options(choice, command.common.threads);
  const FindKeypointsOptions keypoints = keypoint_options(choice, command.common.threads);
  const LogSink warn = make_warning_sink(command.common);
  Timings timings;
  StageTimer load(timings, "load");
  Scene scene = read_scene(a.scene, warn, scene_paths(a.confine));
  load.stop();
  if (options.networks.empty() && keypoints.choice != KeypointChoice::kAll) {
    throw UsageError("detect: expected --detector, --segmenter or --keypoints, or several");
  }
  const fs::path manifest = manifest_of(a.out);
  std::vector<fs::path> inputs = files_of(scene);
  for (const fs::path& file : files_of(choice)) inputs.push_back(file);
  MadeFolder folder(folder_of(manifest));
  refuse_own_inputs({manifest}, inputs);
  StageTimer compute(timings, "compute");
  const Progress progress = make_progress(command.common);
  const std::vector<int> frames = select_frames(scene, a.frames);
  NetworkView view;
  if (!options.networks.empty()) view = detect_frames(scene, frames, options, progress, warn);
  put_network_view(view, &scene);
  const std::optional<NetworkUse> found = find_keypoints(&scene, frames, keypoints, progress, warn);
  compute.stop();
  // The folder of the label images is made when they are written.
  std::vector<fs::path> replaced;
  for (const fs::path& file : detected_scene_files(view, manifest)) {
    std::error_code error;
    if (fs::exists(file, error)) replaced.push_back(file);
  }
  refuse_own_inputs(replaced, inputs);
  StageTimer write(timings, "write");
  write_detected_scene(scene, view, manifest);
  folder.keep();
  write.stop();
  if (!command.common.quiet) {
    std::fprintf(stderr, "camber: %s:\n%s", manifest.string().c_str(),
                 describe(view, found).c_str());
  }
  if (a.json) print_json(command, a, view, found, manifest, timings);
  return 0;
}

}  // namespace

void register_detect(App& root) {
  Command* command = add_command(
      root, "detect",
      "Fills a scene with vehicle boxes and road masks by networks that you bring as ONNX files, "
      "each with a short description beside it, and with keypoints by the network that ships or by "
      "yours. Boxes, masks and keypoints that the scene had are replaced.",
      "  camber detect scene --out detected --detector yolox_nano.onnx\n"
      "  camber detect scene --out detected --detector yolox_nano.onnx --segmenter road.onnx "
      "--frames 0:20\n"
      "  camber detect scene --out detected --keypoints shipped");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  app.add_option("scene", a.scene, "scene manifest (scene.json) or its folder")->required();
  add_confine_option(app, a.confine);
  app.add_option("--out", a.out, "manifest to write (.json), or its folder")
      ->output_manifest()
      ->required();
  add_network_options(app, a.networks);
  app.add_option("--frames", a.frames,
                 "frame ids to look at: 48,49,50, 48:52, 0:10:5 or all; default: all")
      ->no_name();
  app.add_flag("--json", a.json, "print what was done as JSON to stdout");
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
