// camber synth: a steep-road scene with complete truth.

#include "camber/synth/synthesise.h"

#include <cstdio>
#include <memory>

#include "camber/core/errors.h"
#include "command.h"

namespace camber::tools {

void register_synth(App& root) {
  Command* command = add_command(
      root, "synth", "Makes a scene of a steep road with cars: images, detections, complete truth",
      "  camber synth --profile steep_hill --frames 3 --seed 7 --out scene\n"
      "  camber synth --profile crest --size 960x540 --intrinsics 423.8,423.8,479.5,269.5 --hz 5 "
      "--out scene");
  struct Arguments {
    SynthOptions options;
    std::string profile = std::string(to_string(SynthOptions().profile));
    std::string out;
    std::vector<int> size;
    std::vector<double> intrinsics;
    bool overwrite = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  SynthOptions& o = arguments->options;
  App& app = *command->app;
  app.add_option("--out", arguments->out, "folder of the scene")->required();
  app.add_flag("--overwrite", arguments->overwrite, "replace a foreign folder that is not empty");
  std::vector<std::string> kinds;
  for (const RoadProfileKind kind : all_road_profile_kinds()) kinds.emplace_back(to_string(kind));
  app.add_option("--profile", arguments->profile, "shape of the road")
      ->check(is_member(kinds))
      ->capture_default_str();
  app.add_option("--name", o.name, "name of the scene; default: profile and seed");
  app.add_option("--frames", o.num_frames, "number of frames")->capture_default_str();
  app.add_option("--hz", o.frame_rate, "frames a second")->capture_default_str();
  app.add_option("--speed", o.speed, "of the camera's car, m/s")->capture_default_str();
  app.add_option("--camera-height", o.camera_height, "above the road, m")->capture_default_str();
  app.add_option("--cars", o.num_cars, "number of cars, at most")->capture_default_str();
  app.add_option("--nearest", o.nearest_car, "nearest car ahead, m")->capture_default_str();
  app.add_option("--farthest", o.farthest_car, "farthest car ahead, m")->capture_default_str();
  app.add_option("--size", arguments->size, "width and height of the images, px (default 1242x375)")
      ->delimiter('x')
      ->expected(2);
  app.add_option("--intrinsics", arguments->intrinsics,
                 "fx,fy,cx,cy, px (default: KITTI's, scaled to the size's width)")
      ->delimiter(',')
      ->expected(4);
  app.add_option("--supersampling", o.sensor.supersampling, "samples a pixel and direction")
      ->capture_default_str();
  app.add_option("--noise", o.sensor.noise, "of the images, grey levels")->capture_default_str();
  app.add_option("--blur", o.sensor.blur, "of the lens, px")->capture_default_str();
  app.add_option("--cloud-points", o.cloud_points, "points of the true road cloud")
      ->capture_default_str();

  command->run = [command, arguments] {
    SynthOptions options = arguments->options;
    options.seed = command->common.seed;
    options.num_threads = command->common.threads;
    options.command = command->common.command_line;
    options.profile = road_profile_kind_from_string(arguments->profile);
    if (!arguments->size.empty()) {
      const double scale = static_cast<double>(arguments->size[0]) / options.camera.width;
      options.camera.width = arguments->size[0];
      options.camera.height = arguments->size[1];
      options.camera.fx *= scale;
      options.camera.fy *= scale;
      options.camera.cx = scale * (options.camera.cx + 0.5) - 0.5;
      options.camera.cy = 0.46 * options.camera.height;
    }
    if (!arguments->intrinsics.empty()) {
      options.camera.fx = arguments->intrinsics[0];
      options.camera.fy = arguments->intrinsics[1];
      options.camera.cx = arguments->intrinsics[2];
      options.camera.cy = arguments->intrinsics[3];
    }
    const SynthSummary summary = synthesise_scene(options, arguments->out, arguments->overwrite,
                                                  make_progress(command->common));
    if (!command->common.quiet) {
      std::fprintf(stderr, "%s: %d frames, %d cars, %d detections\n", arguments->out.c_str(),
                   options.num_frames, summary.cars, summary.detections);
    }
    return 0;
  };
}

}  // namespace camber::tools
