// camber drive: a whole drive of one moving camera to a metric trajectory, the road and vehicles.

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "command.h"
#include "drive_batch.h"
#include "drive_job.h"
#include "scene_input.h"

namespace camber::tools {
namespace {

struct Arguments {
  DriveArguments drive;
  std::vector<std::string> scenes;
  std::string list;
  bool json = false;
};

int run(const Command& command, Arguments& a) {
  const std::vector<std::string> scenes = scenes_of(a.scenes, a.list);
  if (scenes.size() > 1 || !a.list.empty())
    return run_drive_batch(command, a.drive, scenes, a.json);
  a.drive.input.path = scenes.front();
  const DriveOutcome outcome = run_drive_job(command, a.drive);
  for (const auto& warning : outcome.run->value("warnings", nlohmann::json::array())) {
    std::fprintf(stderr, "camber: warning: %s\n", warning.at("text").get<std::string>().c_str());
  }
  if (a.json) {
    std::printf("%s\n", outcome.run->dump(2).c_str());
  } else if (!command.common.quiet) {
    std::printf("%s%s\n", describe_drive(a.drive.out, *outcome.run).c_str(),
                outcome.was_there ? " (it was there)" : "");
  }
  return 0;
}

}  // namespace

void register_drive(App& root) {
  Command* command = add_command(
      root, "drive",
      "Turns a whole drive of one moving camera into a metric trajectory, the road along it and "
      "the vehicles on it as tracks: frames are read one after the other, windows of a few of them "
      "go through the stages of reconstruct, and all windows together give the drive. An "
      "interrupted run leaves what it measured; --resume goes on from there. Of several scenes "
      "each "
      "gets a folder in --out, and summary.csv has a row for each.",
      "  camber drive kitti/scene.json --out out/drive\n"
      "  camber drive drive.mp4 --height 1.3 --fov 70 --out out/drive\n"
      "  camber drive kitti/scene.json --frames 0:200 --out out/drive --resume\n"
      "  camber drive drives/*/scene.json --out out/drives --resume");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  add_scene_inputs(app, a.drive.input, a.scenes);
  add_network_options(app, a.drive.networks);
  app.add_option("--list", a.list,
                 "file with a scene a line (blank lines and lines that begin with # count for "
                 "nothing): more of them, each into a folder of its name in --out");
  app.add_option("--frames", a.drive.frames,
                 "frame ids: 48:200 (both ends), 0:400:2 or all; default: all")
      ->no_name();
  app.add_flag("--no-masks", a.drive.no_masks,
               "do not read segmentations and road masks: find the road by geometry");
  add_calibrate_option(app, a.drive.no_calibrate);
  app.add_option("--out", a.drive.out, "result folder; an earlier result there is replaced")
      ->output_folder()
      ->required();
  app.add_option("--film", a.drive.film,
                 "film (.mp4 or .avi) of every frame with road, vehicles, the view from above and "
                 "the profile; default: film.mp4 in --out")
      ->output_file()
      ->default_varies();
  app.add_flag("--no-pictures", a.drive.no_pictures, "write no film, no plots and no report.html");
  app.add_flag(
      "--resume", a.drive.resume,
      "go on with the part that an interrupted run of the same inputs left in --out; a result "
      "that is complete stays as it is");
  app.add_flag("--overwrite", a.drive.overwrite, "replace a folder that is no Camber result");
  app.add_flag("--json", a.json, "print run.json to stdout");
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
