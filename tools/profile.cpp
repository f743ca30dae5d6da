// camber profile: height, grade and cross slope along a line on a surface.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/csv_field.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/export/plan_frame.h"
#include "camber/export/road_to_export.h"
#include "camber/render/result_plots.h"
#include "camber/road/road_profile.h"
#include "camber/scene/results.h"
#include "command.h"
#include "crg_road.h"
#include "profile_cloud.h"
#include "profile_crg.h"
#include "profile_output.h"
#include "profile_xodr.h"
#include "road_arguments.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

struct Arguments {
  std::string surface, plot, line;
  ProfileOutput output;
  ProfileOptions options;
  double levelling_sigma_deg = options.levelling_sigma / kDegree;
  bool as_stored = false;
  std::string road;                ///< id, of an OpenDRIVE file
  CloudProfileArguments of_cloud;  ///< what clouds alone have
};

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }
json percent(double value) { return number(100.0 * value); }

/// Empty for what is not known.
std::string cell(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string();
}

std::size_t covered_stations(const std::vector<ProfilePoint>& profile) {
  return static_cast<std::size_t>(
      std::count_if(profile.begin(), profile.end(),
                    [](const ProfilePoint& point) { return point.status != Status::kFailed; }));
}

/// The whole result but for its timings.
json profile_json(const Command& command, const RoadSurface& surface,
                  const std::vector<ProfilePoint>& profile, const ProfileOptions& options) {
  json stations = json::array();
  for (const ProfilePoint& p : profile) {
    stations.push_back({{"station", p.station},
                        {"status", to_string(p.status)},
                        {"reason", p.reason},
                        {"patch", p.patch},
                        {"point", {p.point.x(), p.point.y(), p.point.z()}},
                        {"height", number(p.height)},
                        {"grade_percent", percent(p.grade)},
                        {"cross_slope_percent", percent(p.cross_slope)},
                        {"vertical_radius", number(p.vertical_radius)},
                        {"sigma_height", number(p.sigma_height)},
                        {"sigma_grade_percent", percent(p.sigma_grade)},
                        {"sigma_cross_slope_percent", percent(p.sigma_cross_slope)},
                        {"vertical_curvature", number(p.vertical_curvature)},
                        {"sigma_vertical_curvature", number(p.sigma_vertical_curvature)}});
  }
  return {{"version", kVersion},
          {"seed", command.common.seed},
          {"options",
           {{"step", options.step},
            {"length", options.length},
            {"reach", options.reach},
            {"levelling_sigma_deg", options.levelling_sigma / kDegree},
            {"drift_sigma", options.drift_sigma}}},
          {"frame", surface.frame},
          {"level", to_string(surface.level)},
          {"metric", surface.metric},
          {"covered_stations", covered_stations(profile)},
          {"stations", std::move(stations)}};
}

/// Of a surface that is not metric no column's name has the unit of a length.
std::string profile_csv(const std::vector<ProfilePoint>& profile, const RoadSurface& surface) {
  const bool metric = surface.metric;
  const std::string frame = csv_field(surface.frame);
  std::string text = fmt::format(
      "station{0},x,y,z,height{0},grade_percent,cross_slope_percent,vertical_radius{0},"
      "sigma_height{0},sigma_grade_percent,sigma_cross_slope_percent,patch,status,"
      "vertical_curvature{1},sigma_vertical_curvature{1},frame,level\n",
      metric ? "_m" : "", metric ? "_per_m" : "");
  for (const ProfilePoint& p : profile) {
    text += fmt::format(
        "{:.3f},{:.4f},{:.4f},{:.4f},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", p.station,
        p.point.x(), p.point.y(), p.point.z(), cell(p.height, 4), cell(100.0 * p.grade, 4),
        cell(100.0 * p.cross_slope, 4), cell(p.vertical_radius, 2), cell(p.sigma_height, 5),
        cell(100.0 * p.sigma_grade, 5), cell(100.0 * p.sigma_cross_slope, 5), p.patch,
        p.status == Status::kFailed ? csv_field(p.reason) : std::string(to_string(p.status)),
        cell(p.vertical_curvature, 6), cell(p.sigma_vertical_curvature, 6), frame,
        to_string(surface.level));
  }
  return text;
}

/// @throws UsageError where nothing is asked for, or a form that there is not.
void check_outputs(const Arguments& args) {
  const std::string plot_kind = fs::path(args.plot).extension().string();
  if (args.output.out.empty() && args.plot.empty() && !args.output.json) {
    throw UsageError("found neither --out, --plot nor --json, expected one of them");
  }
  if (!args.plot.empty() && plot_kind != ".png" && plot_kind != ".svg") {
    throw UsageError("--plot: found '" + args.plot + "', expected FILE.png or FILE.svg");
  }
  args.output.check();
}

/// A surface and a line on it.
struct Inputs {
  fs::path surface_file;
  RoadSurface surface;
  std::vector<Eigen::Vector3d> line;
};

Inputs load(const Arguments& args, const LogSink& warn) {
  Inputs in;
  check_output_file(args.plot);
  if (!args.line.empty()) in.line = read_line(args.line);
  in.surface = read_surface_along(args.surface, in.line, args.options.reach, &in.surface_file);
  if (args.line.empty()) in.line = in.surface.driven_line;
  if (!args.line.empty()) {
    take_line_as_road(args.line, in.line, args.options.reach, warn, &in.surface);
  }
  return in;
}

/// @throws NoAnswerError where the line does not lead anywhere.
void check_line(const Inputs& in, const Arguments& args) {
  if (in.line.size() < 2) {
    throw NoAnswerError(in.surface_file.string() +
                        ": holds no driven line; give a line with --along FILE");
  }
  const Eigen::Vector3d& first = in.line.front();
  const bool moves = std::any_of(in.line.begin(), in.line.end(), [&](const Eigen::Vector3d& place) {
    return in.surface.up.cross(place - first).norm() > 1e-9;
  });
  if (!moves) {
    throw NoAnswerError((args.line.empty() ? in.surface_file.string() : args.line) +
                        ": the line does not leave its first point");
  }
}

std::string remark_on_line(const Inputs& in) {
  const PlanFrame plan(in.surface.up);
  std::vector<Eigen::Vector3d> line;
  for (const Eigen::Vector3d& place : in.line) line.push_back(plan.to_plan(place));
  std::vector<std::vector<Eigen::Vector3d>> outlines;
  for (const PlanePatch& patch : in.surface.patches) {
    outlines.emplace_back();
    for (const Eigen::Vector3d& x : patch.boundary) outlines.back().push_back(plan.to_plan(x));
  }
  return tools::remark_on_line(line, outlines, line_frame(in.surface));
}

/// The plot of --plot, drawn: an SVG's text or a picture.
struct DrawnPlot {
  std::string svg;
  Image picture;
};

DrawnPlot draw(const Arguments& args, const std::vector<ProfilePoint>& profile,
               const RoadSurface& surface, Timings& timings) {
  DrawnPlot drawn;
  if (args.plot.empty()) return drawn;
  const StageTimer timer(timings, "draw");
  const PlotSheet sheet = profile_plots(
      profile, surface.metric, profile_title("Profile of the road", to_string(surface.level)));
  if (fs::path(args.plot).extension() == ".svg") {
    drawn.svg = plots_svg(sheet);
  } else {
    drawn.picture = draw_plots(sheet, {1200, 360, 20.0});
  }
  return drawn;
}

/// @param result  profile_json(): the timings so far are added.
void write(const Arguments& args, const std::vector<ProfilePoint>& profile,
           const RoadSurface& surface, const DrawnPlot& plot, const json& result,
           Timings& timings) {
  const StageTimer timer(timings, "write");
  AtomicFiles files;
  if (!plot.svg.empty()) {
    write_file_atomically(files.stage(args.plot), plot.svg);
  } else if (!args.plot.empty()) {
    write_png(plot.picture, files.stage(args.plot));
  }
  args.output.stage([&] { return profile_csv(profile, surface); }, result, timings, &files);
  files.commit();
}

/// @throws UsageError where an option is too small for the line; the library names it as we do.
std::vector<ProfilePoint> profile_of(const Inputs& in, const ProfileOptions& options) {
  try {
    return road_profile(in.surface, in.line, options);
  } catch (const std::invalid_argument& error) {
    throw UsageError(std::string("--") + error.what());
  }
}

/// @throws UsageError where an option has nothing in a road file that it could change.
void check_road_file_options(const App& app, const char* found, const char* reason,
                             std::initializer_list<const char*> names) {
  for (const char* name : names) {
    if (app.count(name) > 0) throw UsageError(fmt::format("{}: found {}, {}", name, found, reason));
  }
  for (const char* name : {"--plot", "--levelling-sigma-deg", "--drift-sigma"}) {
    if (app.count(name) == 0) continue;
    throw UsageError(fmt::format("{}: found {}, which has no bands", name, found));
  }
}

int run_on_cloud(const Command& command, const Arguments& args) {
  if (command.app->count("--reach") > 0) {
    throw UsageError("--reach: found points, which have no patches; see --half-width");
  }
  CloudProfileArguments of_cloud = args.of_cloud;
  of_cloud.cloud = args.surface;
  of_cloud.line = args.line;
  of_cloud.output = args.output;
  of_cloud.plot = args.plot;
  of_cloud.options.profile = args.options;
  of_cloud.as_stored = args.as_stored;
  of_cloud.options.profile.levelling_sigma = args.levelling_sigma_deg * kDegree;
  return profile_of_cloud(command, of_cloud);
}

/// @throws UsageError where an option is given that clouds alone have.
void check_no_cloud_options(const App& app, const CloudProfileArguments& cloud) {
  const auto refuse = [](const std::string& name) {
    throw UsageError(name + ": found a surface, expected a cloud, a GeoTIFF or a strip");
  };
  for (const char* name :
       {"--half-width", "--ground-from", "--sections", "--up", "--line-crs", "--alignment",
        "--input-format", "--columns", "--crs", "--scan", "--bounds"}) {
    if (app.count(name) > 0) refuse(name);
  }
  // Flags by their values: --print-config has those that are not given, too.
  if (cloud.options.crown) refuse("--crown");
  if (cloud.reading.lenient) refuse("--lenient");
  if (cloud.reading.own_frame) refuse("--own-frame");
}

int run(const Command& command, const Arguments& args) {
  if (args.as_stored && !is_crg(args.surface)) {
    throw UsageError("--as-stored: found '" + args.surface +
                     "', expected an OpenCRG file (.crg), whose modifiers it leaves out");
  }
  if (!args.road.empty() && !is_xodr(args.surface)) {
    throw UsageError("--road: found '" + args.surface + "', expected an OpenDRIVE file (.xodr)");
  }
  // Of an OpenCRG file heights at places, or cross-sections where an option asks for them.
  const bool sections = command.app->count("--half-width") > 0 ||
                        command.app->count("--sections") > 0 || args.of_cloud.options.crown;
  if (is_cloud(args.surface) || (is_crg(args.surface) && sections)) {
    return run_on_cloud(command, args);
  }
  check_no_cloud_options(*command.app, args.of_cloud);
  if (is_crg(args.surface)) {
    check_road_file_options(*command.app, "an OpenCRG file",
                            "whose heights are taken at places and not at stations (--half-width "
                            "takes cross-sections)",
                            {"--step", "--length", "--reach"});
    return profile_crg(command, {args.surface, args.line, args.output, args.as_stored});
  }
  if (is_xodr(args.surface)) {
    check_road_file_options(*command.app, "an OpenDRIVE file", "whose road is the line and exact",
                            {"--along", "--length", "--reach"});
    return profile_xodr(command, {args.surface, args.road, args.output, args.options.step});
  }
  ProfileOptions options = args.options;
  options.levelling_sigma = args.levelling_sigma_deg * kDegree;
  options.validate();
  check_outputs(args);
  Timings timings;
  StageTimer load_timer(timings, "load");
  const Inputs in = load(args, make_warning_sink(command.common));
  if (command.app->count("--levelling-sigma-deg") == 0 && in.surface.level_sigma > 0.0) {
    options.levelling_sigma = in.surface.level_sigma;
  }
  warn_of_unknown_scale(in.surface_file.string(), in.surface.metric, {},
                        make_warning_sink(command.common));
  load_timer.stop();
  check_line(in, args);
  StageTimer compute(timings, "compute");
  const std::vector<ProfilePoint> profile = profile_of(in, options);
  compute.stop();
  const std::size_t covered = covered_stations(profile);
  if (covered == 0) {
    throw NoAnswerError(fmt::format("{}: none of the line's {} stations is covered{}",
                                    in.surface_file.string(), profile.size(), remark_on_line(in)));
  }
  // Drawn before the first file is written: without an answer nothing is.
  const DrawnPlot plot = draw(args, profile, in.surface, timings);
  const json result = profile_json(command, in.surface, profile, options);
  write(args, profile, in.surface, plot, result, timings);
  args.output.print(result, timings);
  if (!command.common.quiet && covered < profile.size()) {
    make_warning_sink(command.common)(
        fmt::format("{} of {} stations are not covered", profile.size() - covered, profile.size()));
  }
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  app.add_option("surface", a.surface,
                 "result folder, its surface.json, the folder strip of a drive, an OpenCRG or "
                 "OpenDRIVE file (.crg, .xodr), or, with --along, a cloud (PCD, PLY, KITTI .bin, "
                 "LAS, LAZ, E57 or text) or a GeoTIFF of heights")
      ->required();
  app.add_option("--out", a.output.out, "FILE.csv or FILE.json")->output_file();
  app.add_option(
         "--plot", a.plot,
         "FILE.png or FILE.svg: height, grade and cross slope (per cent) with their 95 % bands")
      ->output_file();
  app.add_option(
      "--along", a.line,
      "points of a line in order (any cloud format; CSV: columns x, y, z or x_m, y_m, "
      "z_m) in the result's frame: of reconstruct the reference camera's (x right, y down, z "
      "forward), of patches the cloud's, in metres; default: the driven line of the result. Of an "
      "OpenCRG file: places, columns u, v or "
      "x, y; default: its reference line (with --half-width, --crown or --sections as of a cloud). "
      "Of a cloud or a GeoTIFF: in its coordinates and units, "
      "or GeoJSON, GeoPackage, Shapefile, DXF or LandXML (.xml), transformed where it states "
      "another coordinate system");
  app.add_option("--step", a.options.step, "metres between stations")
      ->check(positive_number())
      ->capture_default_str()
      ->default_varies();
  app.add_option(
         "--length", a.options.length,
         "metres of road over which grade and vertical radius are measured, on heights every "
         "tenth of it or closer")
      ->check(positive_number())
      ->capture_default_str()
      ->default_varies();
  app.add_option("--reach", a.options.reach,
                 "metres that a station may lie beyond a patch's boundary")
      ->check(non_negative_number())
      ->capture_default_str()
      ->default_varies();
  app.add_option("--levelling-sigma-deg", a.levelling_sigma_deg,
                 "how well the cloud's up is known, degrees: part of the bands; default: as the "
                 "surface states it")
      ->check(non_negative_number())
      ->capture_default_str()
      ->default_varies();
  app.add_option("--drift-sigma", a.options.drift_sigma,
                 "metres by which the cloud's heights may drift along the road: part of the bands")
      ->check(non_negative_number())
      ->capture_default_str()
      ->default_varies();
  CloudProfileArguments& cloud = a.of_cloud;
  app.add_option("--half-width", cloud.options.half_width,
                 "metres to either side of the line over which the cross slope of a cloud's ground "
                 "is measured, as far as the road's edges (kerb, ditch, bank)")
      ->check(positive_number())
      ->capture_default_str()
      ->default_varies();
  app.add_flag("--crown", cloud.options.crown,
               "of a cloud: also the cross slopes left and right of the crest");
  app.add_option("--ground-from", cloud.ground_from,
                 "where the ground of a cloud comes from: class (ASPRS classes 2 and 11), label "
                 "(an int ground), compute (as camber ground), all (every point), or auto: the "
                 "first of them that the cloud has")
      ->check(is_member({"auto", "class", "label", "compute", "all"}))
      ->capture_default_str()
      ->default_varies();
  app.add_option("--sections", cloud.sections,
                 "FILE.png or FILE.svg: up to twelve cross-sections of a cloud's ground")
      ->output_file();
  app.add_option("--up", cloud.up.up_values,
                 "up direction x,y,z of a cloud; default: the camera's (0,-1,0) for clouds that "
                 "Camber wrote in a camera's frame, else 0,0,1")
      ->delimiter(',')
      ->expected(3);
  add_line_arguments(app, cloud.along);
  add_cloud_arguments(app, cloud.reading);
  app.add_option("--road", a.road, "of an OpenDRIVE file with several roads: the id of one")
      ->no_name();
  app.add_flag("--as-stored", a.as_stored,
               "of an OpenCRG file: without its modifiers, unknown cells left unknown");
  app.add_flag("--json", a.output.json, "print the stations as JSON to stdout");
}

}  // namespace

void register_profile(App& root) {
  Command* command =
      add_command(root, "profile", "Height, grade and cross slope along a road",
                  "  camber profile results --out profile.csv\n"
                  "  camber profile results --plot profile.png\n"
                  "  camber profile results --json > profile.json\n"
                  "  camber profile surface --along centreline.csv --step 5 --out profile.json\n"
                  "  camber profile road.crg --along places.csv --out heights.csv\n"
                  "  camber profile road.crg --half-width 3 --crown --out sections.csv\n"
                  "  camber profile road.xodr --step 2 --out road.csv\n"
                  "  camber profile terrain.tif --along centreline.gpkg --out profile.csv\n"
                  "  camber profile survey.las --along centreline.csv --crown --out profile.csv "
                  "--plot profile.png --sections sections.png");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
