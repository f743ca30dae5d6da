// camber convert: clouds, COLMAP models and depth images to cloud files of another format.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "bag_clouds.h"
#include "camber/cloud/number_text.h"
#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/image/image_io.h"
#include "camber/import/depth_cloud.h"
#include "camber/scene/scene.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crs.h"
#include "own_inputs.h"
#include "plugins/recording_plugin.h"
#include "result_map.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  RewriteArguments files;
  std::string depth_encoding, camera, image, labels;
  bool confine = false;
  double baseline = 0.0;
  bool to_map = false;
  BagClouds bag;
  bool overwrite = false;
  double largest_depth = std::numeric_limits<double>::infinity();
};

/// "fx,fy,cx,cy" in pixels, or a scene manifest.
PinholeCamera read_camera(const std::string& text, ScenePaths paths, const fs::path& image,
                          const LogSink& warn) {
  double values[4];
  std::size_t count = 0;
  std::string_view rest = text;
  while (count < 4) {
    const std::size_t comma = std::min(rest.find(','), rest.size());
    const ParsedNumber number = parse_number(rest.data(), rest.data() + comma);
    if (comma == 0 || number.end != rest.data() + comma) break;
    values[count++] = number.value;
    rest.remove_prefix(std::min(comma + 1, rest.size()));
  }
  if (count == 4 && rest.empty()) {
    const ImageInfo info = read_image_info(image);
    PinholeCamera camera;
    camera.width = info.width;
    camera.height = info.height;
    camera.fx = values[0];
    camera.fy = values[1];
    camera.cx = values[2];
    camera.cy = values[3];
    camera.validate();
    return camera;
  }
  if (count > 1)
    throw UsageError("--camera: found '" + text + "', expected fx,fy,cx,cy or a scene");
  return read_scene(text, warn, paths).camera;
}

RoadCloud read_depth(const Arguments& a, const LogSink& warn) {
  if (a.camera.empty()) {
    throw UsageError("--depth needs --camera: fx,fy,cx,cy in pixels, or a scene manifest");
  }
  const PinholeCamera camera = read_camera(a.camera, scene_paths(a.confine), a.files.input, warn);
  DepthImage depth;
  if (a.depth_encoding == "kitti-disparity") {
    if (!(a.baseline > 0.0)) throw UsageError("--depth kitti-disparity needs --baseline, m");
    depth = read_disparity_image(a.files.input, camera, a.baseline);
  } else {
    depth = read_depth_image(a.files.input, a.depth_encoding, camera);
  }
  Image color, labels;
  if (!a.image.empty()) color = read_color_image(a.image);
  if (!a.labels.empty()) labels = read_label_image(a.labels, camera);
  return cloud_from_depth(depth, camera, a.image.empty() ? nullptr : &color,
                          a.labels.empty() ? nullptr : &labels, a.largest_depth);
}

/// A cloud of a result, on the map.
RoadCloud read_on_map(const Arguments& a, const LogSink& warn, CoordinateSystem* system) {
  CloudFile file = read_cloud_file(a.files.input, a.files.cloud.read_options());
  warn_about(a.files.input, file.report, warn);
  if (file.cloud.frame != CloudFrame::kCamera) {
    throw UsageError("--to-map: '" + a.files.input +
                     "' is not in a camera's frame, expected a cloud of reconstruct");
  }
  const std::optional<GeoReference> map = georeference_beside(a.files.input);
  if (!map) {
    throw NoAnswerError(a.files.input +
                        ": no run.json with a georeference beside it; give import --gnss");
  }
  *system = crs_from_definition(map->crs, a.files.input + ": the georeference beside it");
  take_to_map(*map, &file.cloud);
  return std::move(file.cloud);
}

/// Clouds of a recording.
int run_on_bag(const Command& command, const Arguments& args, const WriteOptions& write) {
  const LogSink warn = make_warning_sink(command.common);
  std::error_code error;
  const std::string& out_name = args.files.out;
  if (out_name.empty() || (out_name.back() != '/' && !fs::is_directory(out_name, error))) {
    require_known_output(out_name, write);
    check_output_file(out_name);
  }
  Timings timings;
  StageTimer writing(timings, "write");
  const BagCloudsWritten written =
      write_bag_clouds(args.files.input, args.bag, args.files.out, write, args.overwrite);
  writing.stop();
  for (const std::string& note : written.notes) {
    if (warn) warn(args.files.out + ": " + note);
  }
  if (args.files.as_json) {
    json out = {{"version", kVersion},
                {"seed", command.common.seed},
                {"options",
                 {{"topic", args.bag.topic},
                  {"message", args.bag.message},
                  {"merge", args.bag.merge},
                  {"encoding", args.files.output.encoding},
                  {"format", args.files.output.format}}},
                {"timings_ms", cloud_timings(timings)},
                {"input", args.files.input},
                {"out", args.files.out},
                {"files", written.files},
                {"messages", written.messages},
                {"points", written.points},
                {"output_notes", written.notes}};
    add_other_options(command, &out["options"]);
    fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
  }
  return 0;
}

}  // namespace

void register_convert(App& root) {
  Command* command = add_command(
      root, "convert",
      "Writes a cloud, a COLMAP model's points or a depth image as a cloud file of another format. "
      "Clouds stream through: files of any size need little memory.",
      "  camber convert scan.pcd --out scan.ply\n"
      "  camber convert 000000.bin --out scan.pcd --encoding compressed\n"
      "  camber convert points.txt --columns x,y,z,_,intensity --out points.las\n"
      "  camber convert sparse/0 --out points.ply\n"
      "  camber convert depth.png --depth kitti --camera 721.5,721.5,609.6,172.9 --out depth.ply\n"
      "  camber convert DepthLeft/000001.png --depth synthia --camera scene.json "
      "--image RGBLeft/000001.png --out truth.ply\n"
      "  camber convert drive.mcap --topic /lidar/points --out clouds/\n"
      "  camber convert drive.mcap --merge --out map.ply\n"
      "  camber convert results/road.ply --to-map --out road.las");
  const auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  add_rewrite_arguments(app, a.files, "cloud file, folder of a COLMAP model, or depth image");
  app.add_option(
         "--depth", a.depth_encoding,
         "the input is a depth image: kitti (16 bits, m * 256), kitti-disparity, or synthia "
         "(24 bits)")
      ->check(is_member({"kitti", "kitti-disparity", "synthia"}));
  app.add_option("--camera", a.camera, "of a depth image: fx,fy,cx,cy in px, or a scene manifest");
  add_confine_option(app, a.confine);
  app.add_option("--baseline", a.baseline, "of a disparity image's stereo pair, m");
  app.add_option("--largest-depth", a.largest_depth, "leave out pixels farther away, m")
      ->check(positive_number());
  app.add_option("--image", a.image, "colours for a depth image, same size");
  app.add_option("--labels", a.labels, "label image for a depth image, same size");
  app.add_flag("--to-map", a.to_map,
               "a cloud of reconstruct in map coordinates, with their system, where the scene had "
               "positions (import --gnss)");

  app.add_option("--topic", a.bag.topic,
                 "of a recording (MCAP, rosbag2, bag of ROS 1): topic of PointCloud2; default: the "
                 "only one. --out FOLDER/ writes a file a message, named by its stamp")
      ->no_name();
  app.add_option("--message", a.bag.message, "of a recording: this message alone, from 0")
      ->check(in_range(0, 1000000000));
  app.add_flag("--merge", a.bag.merge,
               "of a recording: all messages as one cloud, placed by /tf or odometry");
  app.add_flag("--overwrite", a.overwrite, "replace a folder that is not a Camber result");

  command->run = [command, arguments] {
    const Arguments& args = *arguments;
    const LogSink warn = make_warning_sink(command->common);
    const WriteOptions write = args.files.output.write_options();
    if (!args.bag.topic.empty() || args.bag.merge || looks_like_bag(args.files.input)) {
      return run_on_bag(*command, args, write);
    }
    require_known_output(args.files.out, write);
    check_output_file(args.files.out);
    Timings timings;
    StageTimer load(timings, "load");
    RoadCloud cloud;
    std::unique_ptr<PointSource> source;
    if (!args.depth_encoding.empty()) {
      cloud = read_depth(args, warn);
      source = make_point_source(cloud);
    } else if (args.to_map) {
      CoordinateSystem system;
      cloud = read_on_map(args, warn, &system);
      source = with_crs(make_point_source(cloud), system);
    } else {
      source =
          open_typed_source(args.files.input, args.files.cloud.read_options(),
                            write.format ? write.format : format_from_extension(args.files.out));
      if (args.files.cloud.lenient) source = drop_bad_points(std::move(source));
      source = with_complete_crs(std::move(source), args.files.out, write);
    }
    load.stop();
    StageTimer writing(timings, "write");
    std::vector<std::string> notes;  // of the output
    const std::uint64_t points =
        write_points(*source, args.files.out, write, make_progress(command->common), &notes);
    writing.stop();
    const ReadReport& report = source->report();
    warn_about(args.files.input, report, warn);
    warn_about_losses(args.files.input, source->header(), report, write, args.files.out, warn);
    for (const std::string& note : notes) {
      if (warn) warn(args.files.out + ": " + note);
    }
    if (report.faces > 0 && warn) {
      warn(fmt::format("{}: {} faces are not written", args.files.input, report.faces));
    }
    if (args.files.as_json) {
      json dropped = json::object();
      for (const auto& [reason, count] : report.dropped) dropped[reason] = count;
      const double farthest = args.largest_depth;
      json out = {{"version", kVersion},
                  {"seed", command->common.seed},
                  {"options",
                   {{"lenient", args.files.cloud.lenient},
                    {"encoding", args.files.output.encoding},
                    {"format", args.files.output.format},
                    {"depth", args.depth_encoding},
                    {"camera", args.camera},
                    {"baseline", args.baseline},
                    {"largest_depth", std::isfinite(farthest) ? json(farthest) : json()},
                    {"image", args.image},
                    {"labels", args.labels},
                    {"to_map", args.to_map}}},
                  {"timings_ms", cloud_timings(timings)},
                  {"input", args.files.input},
                  {"out", args.files.out},
                  {"points", points},
                  {"dropped", dropped},
                  {"notes", report.notes},
                  {"output_notes", notes}};
      add_other_options(*command, &out["options"]);
      fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
    }
    return 0;
  };
}

}  // namespace camber::tools
