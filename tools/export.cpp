// camber export: the road of a result, or of a cloud along a line, for other programs.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/export/opendrive.h"
#include "camber/export/result_vehicles.h"
#include "camber/export/road_mesh.h"
#include "camber/export/trajectory.h"
#include "camber/scene/georeference.h"
#include "camber/scene/results.h"
#include "camber/scene/scene_of_run.h"
#include "command.h"
#include "crs.h"
#include "export_inputs.h"
#include "export_mcap.h"
#include "export_site.h"
#include "gdal_functions.h"
#include "own_inputs.h"
#include "result_map.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

enum class Target { kOpenCrg, kOpenDrive, kGeoTiff, kMesh, kTrajectory, kMcap };
const std::map<std::string, Target> kTargets = {
    {"opencrg", Target::kOpenCrg},       {"opendrive", Target::kOpenDrive},
    {"geotiff", Target::kGeoTiff},       {"mesh", Target::kMesh},
    {"trajectory", Target::kTrajectory}, {"mcap", Target::kMcap}};
const std::map<std::string, CrgEncoding> kEncodings = {{"text", CrgEncoding::kText},
                                                       {"binary", CrgEncoding::kBinary}};

SmoothLine line_of(const ExportInputs& in, const ExportArguments& args) {
  return leading_somewhere(args, [&] {
    return line_over_ground(*in.ground, in.line, args.tolerance, args.ahead, args.grid.num_threads);
  });
}

/// The matrix that takes the result's frame to that of the file, for `--json` and comments.
json frame_json(const PlanFrame& frame) {
  json rows = json::array();
  for (int i = 0; i < 9; ++i) rows.push_back(frame.plan_from_surface(i / 3, i % 3));
  return rows;
}

json export_crg(const ExportInputs& in, const SmoothLine& line, const ExportArguments& args,
                Timings& timings) {
  StageTimer compute(timings, "compute");
  CrgData data = make_crg(*in.ground, line, args.grid);
  compute.stop();
  data.comment = described(in);
  StageTimer write(timings, "write");
  write_crg(data, args.out);
  write.stop();
  const auto unknown = std::count_if(data.heights.begin(), data.heights.end(),
                                     [](float z) { return std::isnan(z); });
  return {{"sections", data.sections()},          {"columns", data.v.size()},
          {"increment", data.increment},          {"v", {data.v.front(), data.v.back()}},
          {"encoding", to_string(data.encoding)}, {"unknown", unknown},
          {"line_deviation", line.deviation()}};
}

json export_opendrive(const ExportInputs& in, const SmoothLine& line, const ExportArguments& args,
                      Timings& timings) {
  StageTimer compute(timings, "compute");
  OpenDriveOptions options;
  options.name = fs::path(args.out).stem().string();
  options.left = args.grid.left;
  options.right = args.grid.right;
  options.widest = args.grid.widest;
  options.geo_reference = proj_string_of_definition(in.geo_reference);
  options.crg_file = args.crg;
  options.num_threads = args.grid.num_threads;
  std::size_t moving = 0;
  if (args.vehicles) {
    ResultVehicles found = result_vehicles(args.input, in.frame);
    options.vehicles = std::move(found.vehicles);
    moving = found.moving;
  }
  const OpenDriveRoad road = make_opendrive(*in.ground, line, options);
  compute.stop();
  StageTimer write(timings, "write");
  write_file_atomically(args.out, encode_opendrive(road));
  write.stop();
  return {{"pieces", road.plan.size()},
          {"elevations", road.elevation.size()},
          {"vehicles", road.vehicles.size()},
          {"moving_left_out", moving},
          {"geo_reference", in.geo_reference},
          {"line_deviation", line.deviation() + road.line_deviation},
          {"height_rms", road.height_rms},
          {"height_most", road.height_most}};
}

/// How much of the road is taken, for those that sample it.
template <typename Options>
Options strip_of(const ExportArguments& args) {
  Options out;
  out.left = args.grid.left;
  out.right = args.grid.right;
  out.widest = args.grid.widest;
  out.num_threads = args.grid.num_threads;
  return out;
}

json export_mesh(const ExportInputs& in, const SmoothLine& line, const ExportArguments& args,
                 Timings& timings) {
  StageTimer compute(timings, "compute");
  auto options = strip_of<RoadMeshOptions>(args);
  options.step = args.grid.step_u;
  const std::unique_ptr<ColorSource> colors = colors_of(args, in);
  const RoadMesh mesh = make_road_mesh(*in.ground, line, colors.get(), options);
  compute.stop();
  StageTimer write(timings, "write");
  const std::string kind = fs::path(args.out).extension().string();
  write_file_atomically(args.out, kind == ".glb"   ? encode_glb(mesh)
                                  : kind == ".obj" ? encode_obj(mesh)
                                                   : encode_ply(mesh));
  write.stop();
  return {{"points", mesh.points.size()},
          {"triangles", mesh.triangles.size()},
          {"colors", !mesh.colors.empty()},
          {"line_deviation", line.deviation()}};
}

json export_geotiff(const ExportInputs& in, const SmoothLine& line, const ExportArguments& args,
                    Timings& timings) {
  const GdalFunctions& writer = gdal_functions();
  StageTimer compute(timings, "compute");
  auto options = strip_of<RoadRasterOptions>(args);
  options.cell = args.grid.step_u;
  const std::unique_ptr<ColorSource> colors = colors_of(args, in);
  const RoadRaster raster = make_road_raster(*in.ground, line, colors.get(), options);
  compute.stop();
  StageTimer write(timings, "write");
  const std::map<std::string, std::string> metadata = {
      {"TIFFTAG_SOFTWARE", std::string("Camber ") + kVersion},
      {"TIFFTAG_IMAGEDESCRIPTION", in.described},
      {"CAMBER_LEVEL", in.level}};
  write_file_atomically(args.out, writer.encode_geotiff(raster, in.geo_reference, metadata));
  write.stop();
  const auto unknown = std::count_if(raster.heights.begin(), raster.heights.end(),
                                     [](float z) { return std::isnan(z); });
  return {{"columns", raster.columns},
          {"rows", raster.rows},
          {"cell", raster.cell},
          {"west", raster.west},
          {"north", raster.north},
          {"unknown", unknown},
          {"colors", !raster.colors.empty()},
          {"geo_reference", in.geo_reference},
          {"line_deviation", line.deviation()}};
}

/// The cameras of a run with their times: those of its scene where that can be read and has them,
/// else the frames' numbers.
std::vector<StampedPose> run_poses(const RunDocument& run, const ExportArguments& args,
                                   const LogSink& warn, std::string* clock) {
  std::map<int, double> times;
  std::string missing;
  const std::optional<Scene> scene =
      read_scene_of_run(run, args.input, {}, scene_paths(args.confine), &missing);
  if (args.confine && !missing.empty() && warn) warn(args.input + ": " + missing);
  if (scene) {
    for (const SceneFrame& frame : scene->frames) {
      if (frame.time_s) {
        times[frame.id] = *frame.time_s;
      } else if (scene->frame_rate) {
        times[frame.id] = frame.id / *scene->frame_rate;
      }
    }
  }
  const bool known = std::all_of(
      run.cameras.begin(), run.cameras.end(),
      [&](const RunDocument::CameraPose& camera) { return times.count(camera.id) > 0; });
  *clock = known ? "seconds" : "frames";
  std::vector<StampedPose> poses;
  for (const RunDocument::CameraPose& camera : run.cameras) {
    poses.push_back(
        {camera.id, known ? times[camera.id] : camera.id, camera.reference_from_camera});
  }
  return poses;
}

json export_trajectory(const CommonOptions& common, const ExportArguments& args, Timings& timings) {
  StageTimer load(timings, "load");
  const fs::path file = road_folder(args.input) / "run.json";
  std::string clock;
  const RunDocument run = read_run(file);
  if (run.cameras.empty()) throw NoAnswerError(file.string() + ": the run has no camera poses");
  const LogSink warn = make_warning_sink(common);
  if (!run.metric && warn) {
    warn(file.string() + ": the run is up to an unknown scale, and so are the positions");
  }
  std::vector<StampedPose> poses = run_poses(run, args, warn, &clock);
  const std::optional<GeoReference> map = georeference_of(run, file);
  if (map) {
    for (StampedPose& pose : poses) {
      pose.world_from_camera = map->map_from_reference * pose.world_from_camera;
    }
  }
  const std::string kind = fs::path(args.out).extension().string();
  if (kind == ".gpx" && !map) {
    throw NoAnswerError(file.string() +
                        ": the run has no place on the earth, which GPX is about; give import "
                        "--gnss");
  }
  load.stop();
  StageTimer write(timings, "write");
  write_file_atomically(
      args.out, kind == ".gpx"   ? encode_gpx(track_on_earth(poses, map->crs, clock == "seconds"))
                : kind == ".tum" ? encode_tum(poses)
                : kind == ".csv" ? encode_pose_csv(poses)
                                 : encode_kitti_poses(poses));
  write.stop();
  return {{"poses", poses.size()},
          {"clock", clock},
          {"metric", run.metric},
          {"geo_reference", map ? map->crs : std::string()}};
}

/// The form of a mesh or trajectory is that of its name. @throws UsageError
void check_extension(const ExportArguments& args) {
  const std::string kind = fs::path(args.out).extension().string();
  if (args.target == "mesh" && kind != ".glb" && kind != ".obj" && kind != ".ply") {
    throw UsageError("--out: found '" + args.out + "', expected FILE.glb, FILE.obj or FILE.ply");
  }
  if (args.target == "trajectory" && kind != ".tum" && kind != ".txt" && kind != ".csv" &&
      kind != ".gpx") {
    throw UsageError("--out: found '" + args.out +
                     "', expected FILE.tum, FILE.txt (KITTI), FILE.csv or FILE.gpx");
  }
}

/// What a command line asks for that cannot be. @throws UsageError
void check_arguments(const ExportArguments& args) {
  const std::pair<const char*, double> lengths[] = {
      {"--ahead", args.ahead}, {"--tolerance", args.tolerance}, {"--reach", args.reach}};
  for (const auto& [option, length] : lengths) {
    if (length >= 0.0) continue;
    throw UsageError(fmt::format("{}: found {}, expected metres >= 0", option, length));
  }
  const std::pair<const char*, double> steps[] = {{"--step", args.grid.step_u},
                                                  {"--step-across", args.grid.step_v}};
  for (const auto& [option, step] : steps) {
    if (step == 0.0 || step >= 0.001) continue;
    throw UsageError(
        fmt::format("{}: found {:g}, expected 0 or 0.001 to 100 metres", option, step));
  }
  std::error_code ignored;
  if (args.vehicles && !fs::exists(fs::path(args.input) / "vehicles.json", ignored)) {
    throw UsageError("--vehicles: found no vehicles.json in '" + args.input +
                     "', expected a result folder of reconstruct");
  }
  check_extension(args);
  const bool of_cameras = args.target == "trajectory" || args.target == "mcap";
  if (of_cameras && fs::is_regular_file(args.input, ignored)) {
    throw UsageError("--to " + args.target + ": found the file '" + args.input +
                     "', expected a result folder, whose run.json has the cameras");
  }
  if (args.target == "geotiff") gdal_functions();
  if (!is_site(args) &&
      (args.ground_from != "auto" || args.fill_holes > 0.0 || !args.hillshade.empty())) {
    throw UsageError(
        "--ground-from, --fill-holes and --hillshade go with --to geotiff of a cloud without "
        "--along");
  }
  const bool opendrive = args.target == "opendrive";
  if (!opendrive && (args.vehicles || !args.crg.empty())) {
    throw UsageError("--vehicles and --crg go with --to opendrive");
  }
}

json options_json(const ExportArguments& a) {
  return {{"to", a.target},
          {"encoding", a.encoding},
          {"slope", a.slope},
          {"banking", a.banking},
          {"step", a.grid.step_u},
          {"step_across", a.grid.step_v},
          {"left", a.grid.left},
          {"right", a.grid.right},
          {"widest", a.grid.widest},
          {"smoothing", a.grid.smoothing},
          {"ahead", a.ahead},
          {"tolerance", a.tolerance},
          {"reach", a.reach},
          {"ground_from", a.ground_from},
          {"fill_holes", a.fill_holes}};
}

/// Where a line lies too far above or below the ground for its road to be found; empty: nowhere.
std::string remark_on_heights(const GroundBeside& beside) {
  if (beside.far == 0) return {};
  return fmt::format(
      "at {} of {} stations of the line the ground is {:.2f} m {} it, expected a line within "
      "{:.1f} "
      "m of the ground, or one without a column z",
      beside.far, beside.stations, std::abs(beside.above), beside.above > 0.0 ? "above" : "below",
      kPointLevelGap);
}

/// Where a bend of the line takes ground away that is seen; empty: nowhere.
std::string remark_on_bends(const ExportInputs& in, const SmoothLine& line,
                            const ExportArguments& args) {
  const std::optional<TightBend> bend =
      tight_bend(*in.ground, line, args.grid.left, args.grid.right, args.grid.widest);
  if (!bend) return {};
  return fmt::format(
      "the line bends to a radius of {:.2f} m at {:.1f} m along it, which leaves room for {:.2f} m "
      "of road to its {} in place of {:.2f} m; --tolerance, now {:.3g} m, lets it be smoother",
      bend->radius, bend->station, bend->room, bend->left ? "left" : "right", bend->wanted,
      args.tolerance);
}

json export_to_target(const ExportInputs& in, const SmoothLine& line, const ExportArguments& args,
                      Timings& timings) {
  try {
    switch (kTargets.at(args.target)) {
      case Target::kOpenDrive:
        return export_opendrive(in, line, args, timings);
      case Target::kGeoTiff:
        return export_geotiff(in, line, args, timings);
      case Target::kMesh:
        return export_mesh(in, line, args, timings);
      default:
        return export_crg(in, line, args, timings);
    }
  } catch (const NoAnswerError& error) {
    std::string remark = remark_on_line(in.line, in.outlines, in.line_frame);
    if (remark.empty()) {
      remark = remark_on_heights(ground_beside(*in.ground, line, args.grid.num_threads));
      if (remark.empty()) remark = remark_on_bends(in, line, args);
      if (!remark.empty()) remark.insert(0, "; ");
    }
    throw NoAnswerError(error.what() + remark);
  }
}

/// @param args  steps that the data give are filled in
json export_road(const CommonOptions& common, ExportArguments* args, Timings& timings) {
  StageTimer load_timer(timings, "load");
  const ExportInputs in = load_export(*args, common, args);
  load_timer.stop();
  const SmoothLine line = line_of(in, *args);
  json result = export_to_target(in, line, *args, timings);
  const std::string named = args->line.empty() ? args->input : args->line;
  const LogSink warn = make_warning_sink(common);
  for (const std::string& remark :
       {remark_on_heights(ground_beside(*in.ground, line, args->grid.num_threads)),
        remark_on_bends(in, line, *args)}) {
    if (!remark.empty() && warn) warn(named + ": " + remark);
  }
  result["length"] = line.length();
  result["plan_from_surface"] = frame_json(in.frame);
  result["shift"] = {in.frame.shift.x(), in.frame.shift.y(), in.frame.shift.z()};
  return result;
}

int run(const Command& command, const ExportArguments& given) {
  ExportArguments args = given;
  args.grid.encoding = kEncodings.at(args.encoding);
  args.grid.slope_in_line = args.slope == "line";
  args.grid.banking_in_line = args.banking == "line";
  args.grid.num_threads = command.common.threads;
  args.tolerance_given = command.app->count("--tolerance") > 0;
  check_arguments(args);
  args.grid.validate();
  check_output_file(args.out);
  Timings timings;
  json result = args.target == "trajectory" ? export_trajectory(command.common, args, timings)
                : args.target == "mcap"     ? export_mcap(command.common, args, timings)
                : is_site(args)             ? export_site(command.common, args, timings)
                                            : export_road(command.common, &args, timings);
  result["version"] = kVersion;
  result["seed"] = command.common.seed;
  result["options"] = options_json(args);
  result["file"] = args.out;
  if (args.as_json) {
    result["timings_ms"] = cloud_timings(timings);
    fmt::print("{}\n", result.dump(2, ' ', false, json::error_handler_t::replace));
  }
  return 0;
}

template <typename Map>
std::vector<std::string> names_of(const Map& map) {
  std::vector<std::string> names;
  for (const auto& [name, value] : map) names.push_back(name);
  return names;
}

void add_arguments(App& app, ExportArguments& a) {
  app.add_option(
         "input", a.input,
         "result folder of reconstruct or patches, its surface.json, a cloud, or joined results "
         "of camber tiles (--to geotiff)")
      ->required();
  app.add_option("--to", a.target, "what to write")
      ->required()
      ->check(is_member(names_of(kTargets)));
  app.add_option(
         "--out", a.out,
         "the file; a mesh is .glb, .obj or .ply, a trajectory .tum, .txt (KITTI), .csv or .gpx")
      ->output_file()
      ->required();
  app.add_option(
      "--along", a.line,
      "points of a line in order (any cloud format; CSV: columns x, y, z) in the frame of "
      "the input: of a result of reconstruct its reference camera's (x right, y down, z "
      "forward, m), of a cloud its coordinates (without a column z: on its ground), of a result of "
      "patches those of its cloud in metres; default: the driven line of the result");
  app.add_option("--encoding", a.encoding, "numbers of OpenCRG: text (LRFI) or binary (KRBI)")
      ->check(is_member(names_of(kEncodings)))
      ->capture_default_str();
  app.add_option("--step", a.grid.step_u,
                 "metres between cross sections, and the cell of GeoTIFF; 0: from the data")
      ->check(in_range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--step-across", a.grid.step_v, "metres between long sections; 0: from the data")
      ->check(in_range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--left", a.grid.left, "metres left of the line; 0: as far as is seen")
      ->check(in_range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--right", a.grid.right, "metres right of the line; 0: as far as is seen")
      ->check(in_range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--widest", a.grid.widest, "metres to either side, limit of what is seen")
      ->check(in_range(0.001, 1000.0))
      ->capture_default_str();
  app.add_option("--slope", a.slope, "elevation in the reference line or in the grid")
      ->check(is_member({"line", "grid"}))
      ->capture_default_str();
  app.add_option("--banking", a.banking, "banking in the reference line or in the grid")
      ->check(is_member({"line", "grid"}))
      ->capture_default_str();
  app.add_option("--smoothing", a.grid.smoothing,
                 "metres of road over which the line's elevation and banking are taken")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--ahead", a.ahead,
                 "metres that the line may go on straight beyond its last point while ground is "
                 "seen there")
      ->capture_default_str();
  app.add_option("--tolerance", a.tolerance,
                 "metres that the smooth line may pass a point of the given one by; unless given, "
                 "5 times the scatter of its points where that is more, at most 0.3")
      ->capture_default_str();
  app.add_option("--reach", a.reach, "metres that a place may lie beyond a patch's boundary")
      ->capture_default_str();
  app.add_option("--up", a.up.up_values,
                 "up direction x,y,z of a cloud; default: the camera's (0,-1,0) for clouds that "
                 "Camber wrote in a camera's frame, else 0,0,1")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--crg", a.crg,
                 "name of an OpenCRG file of the same input that the OpenDRIVE road refers to");
  app.add_flag("--vehicles", a.vehicles,
               "the vehicles of a result's reference frame as objects of the OpenDRIVE road; of a "
               "drive its parked ones, each once");
  app.add_option("--ground-from", a.ground_from,
                 "what of a whole cloud is ground, for GeoTIFF: class (ASPRS 2 and 11), label "
                 "(ground of 1), compute (as camber ground), all, or auto, the first of the first "
                 "three that the cloud has")
      ->check(is_member({"auto", "class", "label", "compute", "all"}))
      ->capture_default_str();
  app.add_option("--fill-holes", a.fill_holes,
                 "metres, width of the holes of a whole cloud's ground that are filled from the "
                 "ground around, for GeoTIFF; wider ones have no data")
      ->check(in_range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--hillshade", a.hillshade,
                 "file for a hillshade of a whole cloud's ground, GeoTIFF of 8 bits")
      ->output_file();
  add_confine_option(app, a.confine);
  add_cloud_arguments(app, a.reading);
  app.add_flag("--json", a.as_json, "what was written, as JSON on stdout");
}

}  // namespace

void register_export(App& root) {
  Command* command = add_command(
      root, "export",
      "Writes a road for other programs: OpenCRG, OpenDRIVE, GeoTIFF, meshes, trajectories",
      "  camber export results --to opencrg --out road.crg\n"
      "  camber export surface --to opencrg --encoding binary --out road.crg\n"
      "  camber export scan.las --along centreline.csv --to opencrg --out road.crg\n"
      "  camber export results --to opendrive --crg road.crg --vehicles --out road.xodr\n"
      "  camber export scan.las --along centreline.csv --to geotiff --out road.tif\n"
      "  camber export scan.laz --to geotiff --step 0.5 --hillshade shade.tif --out terrain.tif\n"
      "  camber export results --to mesh --out road.glb\n"
      "  camber export results --to trajectory --out cameras.tum");
  const auto arguments = std::make_shared<ExportArguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
