// camber ground: which points of a cloud are ground.

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/stream_filters.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/road/segment_ground.h"
#include "cloud_arguments.h"
#include "command.h"
#include "own_inputs.h"
#include "road_arguments.h"

using nlohmann::json;

namespace camber::tools {

void register_ground(App& root) {
  Command* command = add_command(
      root, "ground",
      "Tells ground from what stands on it: the output is the input cloud, in its order, with an "
      "int ground (1 or 0). For single laser scans, clouds of a camera and airborne scans, in "
      "metres.",
      "  camber ground 000000.bin --out ground.ply --sensor-height 1.73\n"
      "  camber ground road.ply --out ground.ply --json\n"
      "  camber ground airborne.las --out ground.las --largest-object 40\n"
      "  camber ground scan.pcd --out ground.pcd --up 0,0,1 --tolerance 0.1");
  struct Arguments {
    std::string cloud, out;
    CloudArguments reading;
    OutputArguments output;
    UpArguments up;
    GroundOptions options;
    bool as_json = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  GroundOptions& bound = arguments->options;
  App& app = *command->app;
  app.add_option("cloud", arguments->cloud, "PCD, PLY, KITTI .bin, LAS or text")->required();
  app.add_option("--out", arguments->out, "file to write: .ply, .pcd, .bin, .las, .xyz or .csv")
      ->required();
  app.add_option("--sensor-height", bound.sensor_height,
                 "metres of the coordinates' zero above the ground below it; default: unknown")
      ->check(finite_number());
  app.add_option("--up", arguments->up.up_values,
                 "up direction x,y,z; default: the camera's (0,-1,0) for clouds that Camber wrote "
                 "in a camera's frame, else 0,0,1")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--cell", bound.cell,
                 "metres, of the grid; 0: 1, or by the points' spacing for clouds from the air")
      ->capture_default_str();
  app.add_option("--largest-object", bound.largest_object,
                 "metres, shorter side of what may stand on the ground; 0: 12, from the air 30")
      ->capture_default_str();
  app.add_option("--slope", bound.slope,
                 "rise over run within which the ground bends; 0: 0.2, from the air 0.35")
      ->capture_default_str();
  app.add_option("--tolerance", bound.tolerance,
                 "metres of ground points from the surface; 0: by their scatter")
      ->capture_default_str();
  add_cloud_arguments(app, arguments->reading);
  add_output_arguments(app, arguments->output);
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");

  command->run = [command, arguments] {
    GroundOptions options = arguments->options;
    options.validate();
    const WriteOptions write_options = arguments->output.write_options();
    require_known_output(arguments->out, write_options);
    refuse_own_inputs({arguments->out}, {arguments->cloud});
    const ReadOptions read_options = arguments->reading.read_options();
    Timings timings;
    StageTimer load(timings, "load");
    const CloudFile file = read_cloud_file(arguments->cloud, read_options);
    warn_about(arguments->cloud, file.report, make_warning_sink(command->common));
    load.stop();
    options.up = arguments->up.up(file.cloud);
    throw_if_interrupted();
    StageTimer compute(timings, "compute");
    const GroundSegmentation found = segment_ground(file.cloud, options);
    compute.stop();
    if (found.status == Status::kFailed) {
      throw NoAnswerError(arguments->cloud + ": " + found.reason);
    }
    StageTimer write(timings, "write");
    write_labelled_copy(arguments->cloud, read_options, "ground", found.labels, arguments->out,
                        write_options);
    write.stop();
    if (!arguments->as_json) {
      fmt::print("{}: {} of {} points are ground, within {:.2f} m of its surface\n", arguments->out,
                 found.ground, file.cloud.size(), found.tolerance);
      return 0;
    }
    const bool height_known = std::isfinite(options.sensor_height);
    const json out = {
        {"version", kVersion},
        {"seed", command->common.seed},
        {"options",
         {{"up", {options.up.x(), options.up.y(), options.up.z()}},
          {"sensor_height", height_known ? json(options.sensor_height) : json(nullptr)},
          {"cell", options.cell},
          {"largest_object", options.largest_object},
          {"slope", options.slope},
          {"tolerance", options.tolerance}}},
        {"file", arguments->cloud},
        {"out", arguments->out},
        {"points", file.cloud.size()},
        {"ground", found.ground},
        {"from_air", found.from_air},
        {"used",
         {{"cell", found.cell},
          {"largest_object", found.largest_object},
          {"slope", found.slope},
          {"tolerance", found.tolerance}}},
        {"timings_ms", cloud_timings(timings)}};
    fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
    return 0;
  };
}

}  // namespace camber::tools
