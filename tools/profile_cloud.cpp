#include "profile_cloud.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/export/profile_table.h"
#include "camber/image/image_io.h"
#include "camber/render/result_plots.h"
#include "camber/scene/results.h"
#include "crg_road.h"
#include "crs.h"
#include "ground_points.h"
#include "own_inputs.h"
#include "raster_input.h"
#include "strip_input.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kAround = 4.0;  // m beyond the half width in which profile_cloud() looks for edges

/// Points and a line on them.
struct Inputs {
  RoadCloud cloud;
  std::vector<Eigen::Vector3d> line;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  GroundSource source = GroundSource::kAll;
  PointSigmas sigmas = PointSigmas::kShared;
  std::string level = "gravity";
  Eigen::AlignedBox2d extent;   ///< m, where the input lies
  json about = json::object();  ///< what the result says of it
};

/// @throws UsageError for options that change nothing of an input that is no cloud.
void check_no_reading_options(const Command& command, const CloudProfileArguments& args,
                              const char* found, std::vector<std::string> more) {
  more.insert(more.end(), {"--input-format", "--columns", "--scan", "--bounds", "--ground-from",
                           "--up", "--resolution"});
  for (const std::string& name : more) {
    if (command.app->count(name) == 0) continue;
    throw UsageError(fmt::format("{}: found {}, expected a cloud", name, found));
  }
  if (args.reading.lenient || args.reading.own_frame) {
    throw UsageError(fmt::format("{}: found {}, expected a cloud",
                                 args.reading.lenient ? "--lenient" : "--own-frame", found));
  }
}

Inputs load_cloud(const CloudProfileArguments& args, const LogSink& warn) {
  Inputs in;
  CloudFile file = read_cloud_file(args.cloud, args.reading.read_options());
  warn_about(args.cloud, file.report, warn);
  use_metres(args.cloud, &file, warn);
  warn_of_unknown_scale(args.cloud, file.cloud.metric, file.report.crs, warn);
  in.up = args.up.up(file.cloud);
  in.line = read_along(args.line, args.along, file.report.crs, warn);
  in.source = ground_source_from(args.ground_from);
  in.sigmas = PointSigmas::kOfNoise;
  in.cloud = std::move(file.cloud);
  if (in.cloud.frame == CloudFrame::kCamera) in.level = "camera";
  return in;
}

Inputs load_raster(const Command& command, const CloudProfileArguments& args, const LogSink& warn) {
  check_no_reading_options(command, args, "a GeoTIFF", {});
  Inputs in;
  const RasterInput raster(args.cloud, args.reading.crs);
  const std::string remark = remark_on_units(raster);
  if (warn && !remark.empty()) warn(args.cloud + ": " + remark);
  in.line = read_along(args.line, args.along, raster.system(), warn);
  in.cloud = raster.read(corridor_along(in.line, args.options.half_width + kAround));
  if (raster.interpolated()) in.sigmas = PointSigmas::kInterpolated;
  in.extent = raster.extent();
  in.about = {{"band", raster.header().band},
              {"cell", raster.cell()},
              {"interpolated", raster.interpolated()}};
  return in;
}

Inputs load_strip(const Command& command, const CloudProfileArguments& args, const LogSink& warn) {
  check_no_reading_options(command, args, "the strip of a drive", {"--crs", "--line-crs"});
  Inputs in;
  const StripIndex index = read_strip_index(args.cloud);
  in.cloud = read_strip_cells(index);
  in.level = index.level;
  warn_of_unknown_scale(args.cloud, in.cloud.metric, {}, warn);
  in.line = args.line.empty() ? index.line : read_along(args.line, args.along, std::nullopt, warn);
  for (const Eigen::Vector3f& p : in.cloud.points) {
    in.extent.extend((in.cloud.origin + p.cast<double>()).head<2>());
  }
  return in;
}

Inputs load_crg(const Command& command, const CloudProfileArguments& args, const LogSink& warn) {
  check_no_reading_options(command, args, "an OpenCRG file", {"--crs", "--line-crs"});
  Inputs in;
  const CrgData data = read_crg(args.cloud);
  refuse_own_inputs({args.output.out, args.plot, args.sections}, data.files);
  for (const std::string& remark : data.remarks) {
    if (warn) warn(args.cloud + ": " + remark);
  }
  const CrgRoad road(data, !args.as_stored), stored(data, false);
  in.cloud = crg_points(road, stored);
  in.level = "map";
  in.line =
      args.line.empty() ? crg_line(road) : read_along(args.line, args.along, std::nullopt, warn);
  return in;
}

/// @throws UsageError, InputError; NoAnswerError where the line does not lead anywhere.
Inputs load(const Command& command, const CloudProfileArguments& args) {
  const LogSink warn = make_warning_sink(command.common);
  const bool strip = is_strip(args.cloud), crg = is_crg(args.cloud);
  if (args.line.empty() && !strip && !crg) {
    throw UsageError(
        fmt::format("found a {} without --along FILE, expected the line along which to measure",
                    is_raster(args.cloud) ? "GeoTIFF" : "cloud"));
  }
  Inputs in = strip                   ? load_strip(command, args, warn)
              : crg                   ? load_crg(command, args, warn)
              : is_raster(args.cloud) ? load_raster(command, args, warn)
                                      : load_cloud(args, warn);
  if (in.extent.isEmpty()) {
    for (const Eigen::Vector3f& p : in.cloud.points) {
      if (p.allFinite()) in.extent.extend((in.cloud.origin + p.cast<double>()).head<2>());
    }
  }
  for (Eigen::Vector3d& place : in.line) {
    // The way in plan counts.
    if (std::isnan(place.z())) place.z() = 0.0;
  }
  const bool moves = std::any_of(in.line.begin(), in.line.end(), [&](const Eigen::Vector3d& x) {
    return in.up.cross(x - in.line.front()).norm() > 1e-9;
  });
  if (!moves) {
    throw NoAnswerError((args.line.empty() ? args.cloud : args.line) +
                        ": the line does not leave its first point");
  }
  return in;
}

/// Where the ground is, if the line is not: for the message of an empty profile.
std::string where_ground_is(const Inputs& in) {
  if (in.extent.isEmpty()) return {};
  return fmt::format(
      "; the ground lies in x {:.0f} to {:.0f}, y {:.0f} to {:.0f}, the line begins at {:.0f}, "
      "{:.0f}, expected a line in its coordinates",
      in.extent.min().x(), in.extent.max().x(), in.extent.min().y(), in.extent.max().y(),
      in.line.front().x(), in.line.front().y());
}

void check_outputs(const CloudProfileArguments& args) {
  if (args.output.out.empty() && args.plot.empty() && args.sections.empty() && !args.output.json) {
    throw UsageError("found neither --out, --plot, --sections nor --json, expected one of them");
  }
  args.output.check();
  for (const auto& [name, file] :
       {std::pair("--plot", args.plot), std::pair("--sections", args.sections)}) {
    const std::string picture = fs::path(file).extension().string();
    if (!file.empty() && picture != ".png" && picture != ".svg") {
      throw UsageError(std::string(name) + ": found '" + file + "', expected FILE.png or FILE.svg");
    }
  }
  for (const std::string& file : {args.plot, args.sections}) check_output_file(file);
  refuse_own_inputs({args.output.out, args.plot, args.sections}, {args.cloud, args.line});
}

/// Draws a sheet into a file, SVG or PNG by its name.
void write_plots(const PlotSheet& sheet, const PlotStyle& style, const std::string& file,
                 AtomicFiles* files) {
  if (fs::path(file).extension() == ".svg") {
    write_file_atomically(files->stage(file), plots_svg(sheet, style));
  } else {
    write_png(draw_plots(sheet, style), files->stage(file));
  }
}

}  // namespace

bool is_cloud(const std::string& path) {
  std::error_code ignored;
  if (is_strip(path)) return true;
  if (!fs::is_regular_file(path, ignored)) return false;
  const std::string kind = fs::path(path).extension().string();
  return kind != ".json" && !is_crg(path) && !is_xodr(path);
}

int profile_of_cloud(const Command& command, const CloudProfileArguments& args) {
  check_outputs(args);
  CloudProfileOptions options = args.options;
  options.num_threads = command.common.threads;
  options.validate();
  Timings timings;
  StageTimer load_timer(timings, "load");
  const Inputs in = load(command, args);
  load_timer.stop();
  throw_if_interrupted();
  StageTimer compute(timings, "compute");
  const RoadCloud& cloud = in.cloud;
  options.sigmas = in.sigmas;
  const GroundBesideLine ground =
      ground_beside_line(cloud, in.up, in.line, options.half_width, in.source, options.num_threads);
  if (ground.status == Status::kFailed) {
    throw NoAnswerError(args.cloud + ": " + ground.reason + where_ground_is(in));
  }
  CloudProfile profile;
  try {
    profile = profile_cloud(cloud, ground.points, in.up, in.line, options);
  } catch (const std::invalid_argument& error) {
    throw UsageError(std::string("--") + error.what());
  }
  if (profile.status == Status::kFailed) {
    throw NoAnswerError(args.cloud + ": " + profile.reason + where_ground_is(in));
  }
  compute.stop();
  const std::size_t answered = answered_stations(profile);
  json result = sections_json(
      profile, options, {args.cloud, args.line, args.ground_from, in.level, cloud.metric, &ground},
      command.common.seed);
  result.update(in.about);
  add_other_options(command, &result["options"]);
  StageTimer write(timings, "write");
  AtomicFiles files;
  if (!args.plot.empty()) {
    write_plots(cross_section_profile_plots(profile, cloud.metric,
                                            profile_title("Profile of the ground", in.level)),
                {1200, 360, 20.0}, args.plot, &files);
  }
  if (!args.sections.empty()) {
    write_plots(cross_section_plots(profile, cloud.metric, "Cross-sections"), {1200, 240, 18.0},
                args.sections, &files);
  }
  args.output.stage([&] { return sections_csv(profile, cloud.metric, options.crown); }, result,
                    timings, &files);
  files.commit();
  write.stop();
  const LogSink warn = make_warning_sink(command.common);
  if (warn && answered < profile.stations.size()) {
    std::string reason;
    for (const CrossSection& at : profile.stations) {
      if (at.status != Status::kFailed || at.reason == reason) continue;
      reason = at.reason;
      warn(args.cloud + ": " + reason);
    }
  }
  if (!args.output.print(result, timings) && !args.output.out.empty()) {
    fmt::print("{}: {} of {} stations, {} points of the ground ({}), noise {:.3f} {}\n",
               args.output.out, answered, profile.stations.size(), ground.points.size(),
               to_string(ground.source), profile.noise, cloud.metric ? "m" : "units");
  }
  return 0;
}

}  // namespace camber::tools
