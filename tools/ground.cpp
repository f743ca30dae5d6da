// camber ground: which points of a cloud are ground.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/road/segment_ground.h"
#include "camber/tiles/ground_tile.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crs.h"
#include "ground_points.h"
#include "plugins/pcl_plugin.h"
#include "plugins/plugin.h"
#include "road_arguments.h"
#include "unknown_scale.h"

using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  std::string cloud, out, engine = "camber", plan;
  CloudArguments reading;
  OutputArguments output;
  UpArguments up;
  GroundOptions options;
  std::vector<int> keep_classes{7, 9, 17, 18};
  bool as_json = false;
};

/// What was written.
struct WrittenGround {
  std::uint64_t points = 0, ground = 0;
  std::uint64_t kept = 0;          // as they were: not asked about
  std::vector<std::string> notes;  // on the output
};

/// The input with its ground: in LAS by the ASPRS classes, else by an int ground.
/// @param judged  which points the labels are of, if not all
/// @param bounds  the part of what was read that is written
WrittenGround write_ground(const Arguments& arguments, const ReadOptions& read_options,
                           const WriteOptions& write_options, std::size_t points,
                           const std::optional<std::vector<int>>& judged, std::vector<int> labels,
                           const std::optional<PlanBounds>& bounds) {
  const std::optional<CloudFormat> format =
      write_options.format ? write_options.format : format_from_extension(arguments.out);
  const bool las = is_las(format);
  std::vector<int> ground;
  if (judged) {
    ground.assign(points, las ? -1 : 0);
    for (std::size_t i = 0; i < judged->size(); ++i) {
      ground[static_cast<std::size_t>((*judged)[i])] = labels[i];
    }
  } else {
    ground = std::move(labels);
  }
  WrittenGround written;
  std::unique_ptr<PointSource> source = open_typed_source(arguments.cloud, read_options, format);
  if (read_options.lenient) source = drop_bad_points(std::move(source));
  source = las ? classify_ground(std::move(source), ground)
               : add_label(std::move(source), "ground", ground);
  std::vector<char> kept(ground.size(), judged ? 1 : 0);
  if (judged) {
    for (const int i : *judged) kept[static_cast<std::size_t>(i)] = 0;
  }
  if (bounds) {
    std::size_t place = 0;
    const auto in_order = [&](const PointStreamHeader& header, const PointBatch& batch,
                              std::vector<unsigned char>* keep) {
      const std::array<int, 3> position = find_roles(header.fields).position;
      const auto value = [&](std::size_t axis, std::size_t i) {
        const auto field = static_cast<std::size_t>(position[axis]);
        return batch.fields[field].number(header.fields[field].type, i);
      };
      for (std::size_t i = 0; i < batch.count; ++i, ++place) {
        if (!bounds->contains(value(0, i), value(1, i))) {
          (*keep)[i] = 0;
          continue;
        }
        written.ground += ground[place] > 0 ? 1 : 0;
        written.kept += kept[place] != 0 ? 1 : 0;
      }
    };
    source = select_rows(std::move(source), in_order);
    source = with_complete_crs(std::move(source), arguments.out, write_options);
    written.points = write_points(*source, arguments.out, write_options, {}, &written.notes);
    return written;
  }
  written.kept = static_cast<std::uint64_t>(std::count(kept.begin(), kept.end(), 1));
  written.ground = static_cast<std::uint64_t>(
      std::count_if(ground.begin(), ground.end(), [](int g) { return g > 0; }));
  source = with_complete_crs(std::move(source), arguments.out, write_options);
  written.points = write_points(*source, arguments.out, write_options, {}, &written.notes);
  return written;
}

GroundSegmentation segment_by(const std::string& engine, const RoadCloud& cloud,
                              const GroundOptions& options) {
  if (engine != "pcl") return segment_ground(cloud, options);
  using Functions = const PclFunctions* (*)();
  static const auto* pcl = reinterpret_cast<Functions>(plugin_symbol("pcl", "camber_pcl"))();
  return pcl->segment_ground(cloud, options);
}

/// What is found of a cloud, and of which of its points.
struct FoundGround {
  GroundSegmentation found;
  std::optional<std::vector<int>> judged;
  std::size_t points = 0;
  bool metric = true;
};

/// By a plan of tiles: as its tiles have it, bit for bit.
FoundGround ground_by_plan(const Arguments& arguments, int threads) {
  const TilePlan plan = read_tile_plan(arguments.plan);
  TileGround whole = segment_whole_ground(plan, arguments.cloud, threads);
  FoundGround out;
  out.points = whole.labels.size();
  out.judged.emplace();
  for (std::size_t i = 0; i < whole.labels.size(); ++i) {
    if (whole.labels[i] < 0) continue;
    out.judged->push_back(static_cast<int>(i));
    out.found.labels.push_back(whole.labels[i]);
  }
  out.found.status = Status::kOk;
  out.found.ground = static_cast<std::size_t>(whole.ground);
  out.found.from_air = plan.ground->from_air;
  out.found.cell = plan.ground->cell;
  out.found.largest_object = plan.ground->largest_object;
  out.found.slope = plan.ground->slope;
  out.found.tolerance = plan.ground->tolerance;
  out.found.ground_area_share = std::numeric_limits<double>::quiet_NaN();  // not measured
  return out;
}

}  // namespace

void register_ground(App& root) {
  Command* command = add_command(
      root, "ground",
      "Tells ground from what stands on it: the output is the input cloud, in its order, with an "
      "int ground (1 or 0); LAS and LAZ get the ASPRS classes 2 and 1 (of points that were 0 or "
      "2). For "
      "single laser scans, clouds of a camera and airborne scans, in "
      "metres.",
      "  camber ground 000000.bin --out ground.ply --sensor-height 1.73\n"
      "  camber ground road.ply --out ground.ply --json\n"
      "  camber ground airborne.las --out ground.las --largest-object 40 --keep-classes 6,7,9,18\n"
      "  camber ground scan.pcd --out ground.pcd --up 0,0,1 --tolerance 0.1");
  const auto arguments = std::make_shared<Arguments>();
  GroundOptions& bound = arguments->options;
  App& app = *command->app;
  app.add_option("cloud", arguments->cloud, "PCD, PLY, KITTI .bin, LAS, LAZ or text")->required();
  app.add_option("--out", arguments->out,
                 "file to write: .ply, .pcd, .bin, .las, .laz, .copc.laz, .xyz or .csv")
      ->output_file()
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
  app.add_option(
         "--keep-classes", arguments->keep_classes,
         "ASPRS classes whose points are left as they are and take no part: 7 and 18 noise, "
         "9 water, 17 bridges; so are withheld points")
      ->check(in_range(0, 255))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--engine", arguments->engine,
                 "camber, or pcl: the Point Cloud Library's progressive morphological filter, for "
                 "comparison (0 means cell 0.5, slope 0.3, tolerance 0.2)")
      ->check(is_member({"camber", "pcl"}))
      ->capture_default_str();
  app.add_option("--plan", arguments->plan,
                 "folder of camber tiles plan: cell, largest object, slope, tolerance and classes "
                 "that are kept are the plan's, and the labels those of its tiles, bit for bit; of "
                 "LAS and LAZ");
  add_cloud_arguments(app, arguments->reading);
  add_output_arguments(app, arguments->output);
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");

  command->run = [command, arguments] {
    GroundOptions options = arguments->options;
    options.validate();
    const WriteOptions write_options = arguments->output.write_options();
    require_known_output(arguments->out, write_options);
    check_output_file(arguments->out);
    ReadOptions read_options = arguments->reading.read_options();
    const std::optional<PlanBounds> bounds = read_options.bounds;
    Timings timings;
    const LogSink warn = make_warning_sink(command->common);
    options.num_threads = command->common.threads;
    FoundGround ground;
    if (!arguments->plan.empty()) {
      if (bounds || read_options.lenient || arguments->engine != "camber") {
        throw UsageError(
            "--plan: found --bounds, --lenient or --engine beside it, expected none "
            "of them");
      }
      StageTimer compute(timings, "compute");
      ground = ground_by_plan(*arguments, command->common.threads);
    } else {
      StageTimer load(timings, "load");
      if (bounds) {
        read_options.bounds =
            bounds->grown(in_units_of_file(arguments->cloud, read_options, ground_margin(options)));
      }
      ReadOptions what_counts = read_options;
      what_counts.attributes = {"classification", "class_flags"};
      CloudFile file = read_labelled_points(arguments->cloud, what_counts);
      warn_about(arguments->cloud, file.report, warn);
      use_metres(arguments->cloud, &file, warn);
      warn_of_unknown_scale(arguments->cloud, file.cloud.metric, file.report.crs, warn);
      if (bounds) require_inside(arguments->cloud, file, *bounds);
      ground.judged = points_to_judge(file.cloud, arguments->keep_classes);
      ground.points = file.cloud.size();
      ground.metric = file.cloud.metric;
      load.stop();
      options.up = arguments->up.up(file.cloud);
      throw_if_interrupted();
      StageTimer compute(timings, "compute");
      ground.found = ground.judged
                         ? segment_by(arguments->engine, file.cloud.select(*ground.judged), options)
                         : segment_by(arguments->engine, file.cloud, options);
    }
    GroundSegmentation& found = ground.found;
    if (found.status == Status::kFailed) {
      throw NoAnswerError(arguments->cloud + ": " + found.reason);
    }
    StageTimer write(timings, "write");
    const WrittenGround written =
        write_ground(*arguments, read_options, write_options, ground.points, ground.judged,
                     std::move(found.labels), bounds);
    write.stop();
    const std::string remark = remark_on_ground(found);
    if (!remark.empty() && arguments->engine == "camber" && arguments->plan.empty() && warn) {
      warn(arguments->cloud + ": " + remark);
    }
    for (const std::string& note : written.notes) {
      if (warn) warn(arguments->out + ": " + note);
    }
    if (!arguments->as_json) {
      fmt::print("{}: {} of {} points are ground, within {:.2f} {} of its surface\n",
                 arguments->out, written.ground, written.points, found.tolerance,
                 ground.metric ? "m" : "units");
      return 0;
    }
    const bool height_known = std::isfinite(options.sensor_height);
    json out = {{"version", kVersion},
                {"seed", command->common.seed},
                {"options",
                 {{"up", {options.up.x(), options.up.y(), options.up.z()}},
                  {"sensor_height", height_known ? json(options.sensor_height) : json(nullptr)},
                  {"cell", options.cell},
                  {"largest_object", options.largest_object},
                  {"slope", options.slope},
                  {"tolerance", options.tolerance},
                  {"engine", arguments->engine},
                  {"keep_classes", arguments->keep_classes}}},
                {"file", arguments->cloud},
                {"out", arguments->out},
                {"metric", ground.metric},
                {"points", written.points},
                {"kept_as_they_are", written.kept},
                {"ground", written.ground},
                {"from_air", found.from_air},
                {"ground_area_share", found.ground_area_share},
                {"used",
                 {{"cell", found.cell},
                  {"largest_object", found.largest_object},
                  {"slope", found.slope},
                  {"tolerance", found.tolerance}}},
                {"timings_ms", cloud_timings(timings)}};
    add_other_options(*command, &out["options"]);
    fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
    return 0;
  };
}

}  // namespace camber::tools
