// camber compare: an estimated cloud, mesh or result against dense truth.

#include "camber/evaluate/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/referred_file.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/evaluate/m3c2.h"
#include "camber/evaluate/number_files.h"
#include "camber/evaluate/scene_truth.h"
#include "camber/export/crg_mesh.h"
#include "camber/export/opendrive_reader.h"
#include "camber/image/image_io.h"
#include "camber/render/comparison_pictures.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crg_road.h"
#include "crs.h"
#include "own_inputs.h"
#include "road_arguments.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

const std::map<std::string, Alignment> kAlignments = {{"none", Alignment::kNone},
                                                      {"scale", Alignment::kScale},
                                                      {"rigid", Alignment::kRigid},
                                                      {"similarity", Alignment::kSimilarity}};

struct Arguments {
  std::string estimate, truth, out;
  CloudArguments reading;
  UpArguments up;
  CompareOptions options;
  std::string alignment = "none";
  std::string transform, pairs, camera;
  std::vector<double> along, region, truth_viewpoint;
  std::string method;
  M3c2Options change;
  bool no_road_frame = false, overwrite = false, as_json = false, confine = false;
};

bool is_scene(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return fs::exists(path / "scene.json", error);
  return path.extension() == ".json";
}

bool is_result(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error) && fs::exists(path / "run.json", error) &&
         fs::exists(road_folder(path) / "road.ply", error);
}

fs::path folder_of_manifest(const fs::path& scene) {
  std::error_code error;
  if (fs::is_directory(scene, error)) return scene;
  return scene.has_parent_path() ? scene.parent_path() : fs::path(".");
}

/// The cloud of a result folder, else the file.
fs::path cloud_of(const std::string& path) {
  return is_result(path) ? road_folder(path) / "road.ply" : fs::path(path);
}

/// The known cells of an OpenCRG road.
Shape read_crg_shape(const fs::path& path, const fs::path& folder, const LogSink& warn) {
  const CrgData data = read_crg(path, folder);
  protect_inputs(data.files);
  for (const std::string& remark : data.remarks) {
    if (warn) warn(path.string() + ": " + remark);
  }
  CrgMesh mesh = crg_mesh(data);
  return {std::move(mesh.cloud), std::move(mesh.triangles)};
}

/// The lanes of all roads of an OpenDRIVE file as a mesh.
Shape xodr_shape(const fs::path& path) {
  const XodrFile file = read_xodr(path);
  Shape shape;
  shape.cloud.frame = CloudFrame::kZUp;
  for (const XodrRoad& road : file.roads) {
    const XodrMesh mesh = xodr_mesh(road);
    if (shape.cloud.points.empty() && !mesh.points.empty()) {
      shape.cloud.origin = mesh.points.front().array().round();
    }
    const auto base = static_cast<std::uint32_t>(shape.cloud.size());
    for (const Eigen::Vector3d& p : mesh.points) {
      shape.cloud.points.push_back((p - shape.cloud.origin).cast<float>());
    }
    for (const std::array<std::uint32_t, 3>& t : mesh.triangles) {
      shape.triangles.push_back({base + t[0], base + t[1], base + t[2]});
    }
  }
  if (!shape.is_mesh()) throw NoAnswerError(path.string() + ": the roads have no lanes");
  return shape;
}

/// Whether the estimate gets the size of the truth.
bool scales(const CompareOptions& options) {
  return options.alignment == Alignment::kScale || options.alignment == Alignment::kSimilarity;
}

/// What a cloud's file states of where its coordinates are.
struct StatedPlace {
  CloudFrame frame = CloudFrame::kUnknown;
  std::optional<CoordinateSystem> crs;
};

/// Of two clouds that are compared as they are.
void warn_of_other_place(const StatedPlace& estimate, const StatedPlace& truth,
                         const LogSink& warn) {
  if (!warn) return;
  const auto known = [](CloudFrame frame) { return frame != CloudFrame::kUnknown; };
  if (known(estimate.frame) && known(truth.frame) && estimate.frame != truth.frame) {
    warn(
        "one cloud is in a camera's frame (y down), the other has z up: they are compared as they "
        "are");
  }
  if (!estimate.crs || !truth.crs || !estimate.crs->stated() || !truth.crs->stated()) return;
  const std::string own = describe(*estimate.crs), other = describe(*truth.crs);
  if (own != other) {
    warn(
        fmt::format("the estimate's coordinate system is {}, the truth's {}: they are compared as "
                    "they are",
                    own, other));
  }
}

/// @param own_size  false: the shape is scaled to another one, its units do not matter
/// @param folder    in which the files that an OpenCRG road names must lie; empty: anywhere
Shape read_shape(const fs::path& path, ReadOptions options, const LogSink& warn,
                 bool own_size = true, const fs::path& folder = {}, StatedPlace* place = nullptr) {
  if (is_crg(path)) {
    Shape shape = read_crg_shape(path, folder, warn);
    if (!shape.is_mesh()) throw NoAnswerError(path.string() + ": no cell has four known corners");
    return shape;
  }
  if (is_xodr(path)) return xodr_shape(path);
  options.triangles = true;
  CloudFile file = read_cloud_file(path, options);
  warn_about(path.string(), file.report, warn);
  use_metres(path.string(), &file, warn);
  if (own_size) {
    warn_of_unknown_scale(path.string(), file.cloud.metric, file.report.crs, warn);
  }
  if (place != nullptr) *place = {file.cloud.frame, file.report.crs};
  Shape shape;
  shape.cloud = std::move(file.cloud);
  shape.triangles = std::move(file.triangles);
  if (shape.cloud.empty()) throw NoAnswerError(path.string() + ": no points to compare");
  return shape;
}

/// The truth cloud of a scene, and the transform that takes it to the reference camera.
Shape read_scene_truth(const std::string& path, const Scene& scene, int reference,
                       const ReadOptions& options, ScenePaths paths, const LogSink& warn,
                       Eigen::Matrix4d* reference_from_truth) {
  if (!scene.truth) throw NoAnswerError(path + ": the scene has no truth");
  if (scene.truth->cloud.empty()) return ground_of_true_depth(path, scene, reference);
  *reference_from_truth = frame_from_truth_cloud(path, scene, reference);
  const fs::path& cloud = scene.truth->cloud;
  const fs::path folder = paths == ScenePaths::kConfined ? folder_of_manifest(path) : fs::path();
  return read_referred_file(
      cloud, "a point cloud, a mesh or an OpenCRG road", warn,
      [&](const LogSink& sink) { return read_shape(cloud, options, sink, true, folder); });
}

json options_json(const Arguments& a, const CompareOptions& o) {
  const auto vector = [](const Eigen::Vector3d& v) { return json{v.x(), v.y(), v.z()}; };
  json out = {
      {"align", a.alignment},           {"thresholds", o.thresholds}, {"up", vector(o.up)},
      {"along", vector(o.along)},       {"road_limit", o.road_limit}, {"map_cell", o.map_cell},
      {"mesh_density", o.mesh_density}, {"views", o.views.size()}};
  std::vector<double> rows;
  for (int i = 0; i < 16; ++i) rows.push_back(o.estimate_from_truth(i / 4, i % 4));
  out["estimate_from_truth"] = rows;
  if (o.region) out["region"] = {vector(o.region->minimum), vector(o.region->maximum)};
  if (o.viewpoint) out["viewpoint"] = vector(*o.viewpoint);
  if (o.truth_viewpoint) out["truth_viewpoint"] = vector(*o.truth_viewpoint);
  if (std::isfinite(o.farthest)) out["farthest"] = o.farthest;
  return out;
}

/// Two shapes, and what is known of how the estimate was made.
struct Inputs {
  Shape estimate, truth;
  std::optional<RunDocument> run;  ///< of the estimate, where that is a result folder
  std::string camera;              ///< the scene whose camera saw the estimate; empty: unknown
};

/// Reads both shapes, and into options->estimate_from_truth what takes the truth to the estimate.
Inputs read_inputs(const Arguments& args, const LogSink& warn, CompareOptions* options) {
  const ReadOptions reading = args.reading.read_options();
  Inputs in;
  in.camera = args.camera;
  StatedPlace estimate, truth;
  in.estimate =
      read_shape(cloud_of(args.estimate), reading, warn, !scales(*options), {}, &estimate);
  if (is_result(args.estimate)) in.run = read_run(road_folder(args.estimate) / "run.json");
  if (!is_result(args.truth) && is_scene(args.truth)) {
    const Scene scene = read_scene(args.truth, warn, scene_paths(args.confine));
    protect_inputs(files_of(scene));
    in.truth = read_scene_truth(args.truth, scene, frame_of_result(in.run, scene), reading,
                                scene_paths(args.confine), warn, &options->estimate_from_truth);
    if (in.camera.empty()) in.camera = args.truth;
    // Depth shows what its camera sees, and nothing of what lies behind a crest.
    const bool depth = scene.truth->cloud.empty() && args.transform.empty();
    if (depth) options->truth_viewpoint = Eigen::Vector3d::Zero();
  } else {
    in.truth = read_shape(cloud_of(args.truth), reading, warn, true, {}, &truth);
    if (args.transform.empty() && options->alignment == Alignment::kNone) {
      warn_of_other_place(estimate, truth, warn);
    }
  }
  if (!args.transform.empty()) options->estimate_from_truth = read_transform(args.transform);
  return in;
}

/// The views of a scene's camera: at the poses of the run, else at the coordinates' zero.
void add_views(const std::string& scene_path, ScenePaths paths,
               const std::optional<RunDocument>& run, const LogSink& warn,
               CompareOptions* options) {
  const Scene scene = read_scene(scene_path, warn, paths);
  if (!run || run->cameras.empty()) {
    options->views.push_back({scene.camera, SE3()});
    return;
  }
  for (const RunDocument::CameraPose& pose : run->cameras) {
    options->views.push_back({scene.camera, pose.reference_from_camera.inverse()});
  }
}

CropBox region_of(const std::vector<double>& numbers) {
  CropBox box;
  box.minimum = {numbers[0], numbers[1], numbers[2]};
  box.maximum = {numbers[3], numbers[4], numbers[5]};
  if (!(box.minimum.array() <= box.maximum.array()).all()) {
    throw UsageError(
        "--region: found a minimum above a maximum, expected "
        "xmin,ymin,zmin,xmax,ymax,zmax");
  }
  return box;
}

/// Up, the road's direction and the viewpoint: as given, else by the frame of the estimate.
void set_directions(const Arguments& args, const RoadCloud& estimate, CompareOptions* options) {
  const bool camera_frame = estimate.frame == CloudFrame::kCamera;
  options->up = args.up.up(estimate);
  options->along = camera_frame ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
  if (!args.along.empty()) options->along = {args.along[0], args.along[1], args.along[2]};
  if (options->along.cross(options->up).norm() < 1e-6 * options->along.norm()) {
    throw UsageError(
        "--along: found a direction along --up, expected one that is level or nearly so");
  }
  options->viewpoint = args.up.viewpoint();
  if (!options->viewpoint && camera_frame) options->viewpoint = Eigen::Vector3d::Zero();
}

/// What the command line alone decides. @throws UsageError, std::invalid_argument.
CompareOptions checked_options(const Command& command, const Arguments& args) {
  CompareOptions options = args.options;
  options.alignment = kAlignments.at(args.alignment);
  options.seed = command.common.seed;
  options.num_threads = command.common.threads;
  options.road_frame = !args.no_road_frame;
  options.validate();
  if (!args.pairs.empty() && options.alignment == Alignment::kNone) {
    throw UsageError("--pairs needs --align scale, rigid or similarity");
  }
  return options;
}

/// Reads the shapes and completes the options with what lies in files or depends on them.
Inputs load(const Arguments& args, const LogSink& warn, CompareOptions* options) {
  Inputs in = read_inputs(args, warn, options);
  if (!args.pairs.empty()) options->pairs = read_point_pairs(args.pairs);
  if (in.camera.empty() && std::isfinite(args.options.farthest)) {
    throw UsageError(
        "--farthest: expected the camera, too: --camera SCENE, or a scene as the truth");
  }
  if (!in.camera.empty()) add_views(in.camera, scene_paths(args.confine), in.run, warn, options);
  if (!args.region.empty()) options->region = region_of(args.region);
  if (!args.truth_viewpoint.empty()) {
    options->truth_viewpoint =
        Eigen::Vector3d(args.truth_viewpoint[0], args.truth_viewpoint[1], args.truth_viewpoint[2]);
  }
  set_directions(args, in.estimate.cloud, options);
  return in;
}

/// Tables, coloured clouds and pictures.
void write_comparison(const CloudComparison& comparison, const CompareOptions& options,
                      const json& result, const fs::path& at) {
  double largest = 0.0;
  for (const double t : options.thresholds) largest = std::max(largest, 2.0 * t);
  write_json(result, at / "compare.json");
  write_file_atomically(at / "scores.csv", scores_csv(comparison));
  write_file_atomically(at / "compare.txt", describe(comparison));
  write_cloud(color_by_distance(comparison.accuracy, largest), at / "accuracy.ply");
  write_cloud(color_by_distance(comparison.completeness, largest), at / "completeness.ply");
  write_png(draw_histogram(comparison), at / "histogram.png");
  write_png(draw_cumulative(comparison), at / "cumulative.png");
  if (options.road_frame) {
    write_file_atomically(at / "road_errors.csv", road_errors_csv(comparison));
    write_file_atomically(at / "height_error.csv", height_map_csv(comparison.map));
    write_png(draw_height_map(comparison), at / "height_error.png");
  }
}

void write_run(const Arguments& args, const CompareOptions& options, bool metric,
               const Timings& timings, const fs::path& at) {
  RunDocument document;
  document.seed = options.seed;
  document.options = options_json(args, options);
  document.options["command"] = "compare";
  document.timings = timings;
  document.metric = metric;
  for (const fs::path& path : {cloud_of(args.estimate), cloud_of(args.truth)}) {
    std::error_code error;
    if (!fs::is_regular_file(path, error)) continue;
    document.input_hashes.emplace_back(path.string(), hash_file(path));
  }
  write_json(to_json(document), at / "run.json");
}

/// Two clouds of different vertical systems differ by more than what has changed.
void warn_of_other_heights(const StatedPlace& later, const StatedPlace& earlier,
                           const LogSink& warn) {
  if (!warn || !later.crs || !earlier.crs) return;
  const CoordinateSystem &a = *later.crs, &b = *earlier.crs;
  if (a.vertical_epsg != b.vertical_epsg && (a.vertical_stated || b.vertical_stated)) {
    const auto name = [](const CoordinateSystem& crs) {
      return crs.vertical_epsg > 0 ? fmt::format("EPSG:{}", crs.vertical_epsg)
             : crs.vertical_stated ? std::string("one in ") + crs.vertical.name
                                   : std::string("none");
    };
    warn(
        fmt::format("the later cloud's vertical system is {}, the earlier one's {}: heights are "
                    "compared as they are, and a difference of their zeros shows as change",
                    name(a), name(b)));
  }
}

json change_options_json(const Arguments& args, const M3c2Options& options) {
  return {{"method", args.method},
          {"normal_scale", options.normal_scale},
          {"cylinder", options.cylinder},
          {"core_spacing", options.core_spacing},
          {"max_depth", options.max_depth},
          {"registration_sigma", options.registration_sigma},
          {"up", {options.up.x(), options.up.y(), options.up.z()}}};
}

/// @throws UsageError for an option that belongs to the other methods.
void check_change_options(const App& app, const Arguments& args) {
  const bool change = args.method == "m3c2" || args.method == "dz";
  const auto refuse = [&](const char* name, const char* expected) {
    if (app.count(name) == 0) return;
    throw UsageError(fmt::format("{}: found with --method {}, expected {}", name,
                                 args.method.empty() ? "none" : args.method, expected));
  };
  if (!change) {
    for (const char* name : {"--normal-scale", "--cylinder", "--core-spacing", "--max-depth",
                             "--registration-sigma"}) {
      refuse(name, "m3c2 or dz");
    }
    return;
  }
  for (const char* name : {"--align", "--pairs", "--estimate-from-truth", "--region", "--camera",
                           "--farthest", "--truth-viewpoint", "--along", "--road-limit",
                           "--map-cell", "--mesh-density", "--no-road-frame", "--thresholds"}) {
    refuse(name, "none of them, c2c or c2m");
  }
  if (args.method == "dz") refuse("--normal-scale", "m3c2");
}

/// --method m3c2 and dz: what has changed between two clouds, with its detection limit.
int run_change(const Command& command, const Arguments& args) {
  M3c2Options options = args.change;
  options.vertical = args.method == "dz";
  options.num_threads = command.common.threads;
  options.validate();
  std::optional<AtomicFolder> folder;
  if (!args.out.empty()) folder.emplace(args.out, args.overwrite);
  const LogSink warn = make_warning_sink(command.common);
  Timings timings;
  StageTimer load_timer(timings, "load");
  StatedPlace later_place, earlier_place;
  const ReadOptions reading = args.reading.read_options();
  const Shape later = read_shape(cloud_of(args.estimate), reading, warn, true, {}, &later_place);
  const Shape earlier = read_shape(cloud_of(args.truth), reading, warn, true, {}, &earlier_place);
  warn_of_other_place(later_place, earlier_place, warn);
  warn_of_other_heights(later_place, earlier_place, warn);
  options.up = args.up.up(earlier.cloud);
  load_timer.stop();
  throw_if_interrupted();
  StageTimer compute(timings, "compute");
  const CloudChange change = measure_change(later.cloud, earlier.cloud, options);
  compute.stop();
  StageTimer write(timings, "write");
  json result = to_json(change);
  result["method"] = args.method;
  result["later"] = args.estimate;
  result["earlier"] = args.truth;
  if (folder) {
    const fs::path at = folder->staging();
    write_json(result, at / "change.json");
    write_file_atomically(at / "change.txt", describe(change));
    write_cloud(change_cloud(change), at / "change.ply");
    write_png(draw_change_histogram(change), at / "histogram.png");
    write_png(draw_change_map(change), at / "change.png");
    RunDocument document;
    document.seed = command.common.seed;
    document.options = change_options_json(args, options);
    document.options["command"] = "compare";
    document.timings = timings;
    document.metric = change.metric;
    for (const fs::path& path : {cloud_of(args.estimate), cloud_of(args.truth)}) {
      document.input_hashes.emplace_back(path.string(), hash_file(path));
    }
    write_json(to_json(document), at / "run.json");
    folder->commit();
  }
  write.stop();
  if (!args.as_json) {
    fmt::print("{}", describe(change));
    return 0;
  }
  result["version"] = kVersion;
  result["seed"] = command.common.seed;
  result["options"] = change_options_json(args, options);
  result["timings_ms"] = cloud_timings(timings);
  fmt::print("{}\n", result.dump(2, ' ', false, json::error_handler_t::replace));
  return 0;
}

int run(const Command& command, const Arguments& args) {
  check_change_options(*command.app, args);
  if (args.method == "m3c2" || args.method == "dz") return run_change(command, args);
  CompareOptions options = checked_options(command, args);
  std::optional<AtomicFolder> folder;
  if (!args.out.empty()) folder.emplace(args.out, args.overwrite);
  Timings timings;
  StageTimer load_timer(timings, "load");
  const Inputs in = load(args, make_warning_sink(command.common), &options);
  if ((args.method == "c2c" && in.truth.is_mesh()) ||
      (args.method == "c2m" && !in.truth.is_mesh())) {
    throw UsageError(fmt::format("--method: found {} with a truth that is a {}", args.method,
                                 in.truth.is_mesh() ? "mesh" : "cloud"));
  }
  load_timer.stop();

  throw_if_interrupted();
  StageTimer compute(timings, "compute");
  const CloudComparison comparison = compare_shapes(in.estimate, in.truth, options);
  compute.stop();

  StageTimer write(timings, "write");
  json result = to_json(comparison);
  result["estimate"] = args.estimate;
  result["truth"] = args.truth;
  if (folder) write_comparison(comparison, options, result, folder->staging());
  write.stop();
  if (folder) {
    write_run(args, options, comparison.metric, timings, folder->staging());
    folder->commit();
  }
  if (!args.as_json) {
    fmt::print("{}", describe(comparison));
    return 0;
  }
  result["version"] = kVersion;
  result["seed"] = options.seed;
  result["options"] = options_json(args, options);
  result["timings_ms"] = cloud_timings(timings);
  fmt::print("{}\n", result.dump(2, ' ', false, json::error_handler_t::replace));
  return 0;
}

void add_alignment_arguments(App& app, Arguments& a) {
  app.add_option("--align", a.alignment,
                 "move the estimate first: none, scale (about the coordinates' zero), rigid or "
                 "similarity; reported with its residual")
      ->check(is_member({"none", "scale", "rigid", "similarity"}))
      ->capture_default_str();
  app.add_option("--pairs", a.pairs,
                 "file of corresponding places for --align, rows x y z of the estimate, x y z of "
                 "the truth; default: iterated closest points");
  app.add_option("--estimate-from-truth", a.transform,
                 "file of a 4 x 4 matrix that takes truth into the estimate's frame");
}

/// Which points count.
void add_visibility_arguments(App& app, Arguments& a) {
  app.add_option(
         "--region", a.region,
         "metres, in the estimate's frame: xmin,ymin,zmin,xmax,ymax,zmax; what lies outside "
         "does not count")
      ->delimiter(',')
      ->expected(6);
  app.add_option(
      "--camera", a.camera,
      "scene whose camera saw the estimate (poses from the result folder): truth outside "
      "its views does not count; default: the truth, where that is a scene");
  app.add_option("--farthest", a.options.farthest,
                 "metres along the camera's axis; truth beyond does not count");
  app.add_option("--truth-viewpoint", a.truth_viewpoint,
                 "place x,y,z, in the truth's frame, from which the truth was measured: estimated "
                 "points behind it, or where it has none, do not count")
      ->delimiter(',')
      ->expected(3);
}

/// The frame in which errors are split, and the points that stand for surfaces.
void add_road_frame_arguments(App& app, Arguments& a) {
  add_up_arguments(app, a.up);
  app.add_option("--along", a.along,
                 "direction x,y,z of the road; default: the camera's axis, else x")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--road-limit", a.options.road_limit,
                 "metres; farther points are not split in the road's frame")
      ->capture_default_str();
  app.add_option("--map-cell", a.options.map_cell, "metres, of the map of height errors")
      ->capture_default_str();
  app.add_option("--mesh-density", a.options.mesh_density,
                 "points a square metre that stand for a mesh")
      ->capture_default_str();
  app.add_flag("--no-road-frame", a.no_road_frame, "no errors in the road's frame: faster");
}

/// What has changed between two epochs.
void add_change_arguments(App& app, Arguments& a) {
  app.add_option("--method", a.method,
                 "m3c2: what has changed between two epochs (the first is the later), signed along "
                 "local normals of the earlier one (+ is gain), with the detection limit at 95 % "
                 "(Lague, Brodu, Leroux 2013); dz: the same along up, for roads; c2c, c2m: "
                 "distances to the nearest point or to the mesh (default, by the truth)")
      ->check(is_member({"c2c", "c2m", "m3c2", "dz"}));
  app.add_option("--normal-scale", a.change.normal_scale,
                 "metres, diameter around a core point whose plane gives its normal; 0: three "
                 "cylinders")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--cylinder", a.change.cylinder,
                 "metres, diameter of the cylinders in which both clouds are averaged; 0: so that "
                 "the sparser one has some 30 points in it")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--core-spacing", a.change.core_spacing,
                 "metres between core points; 0: half a cylinder")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--max-depth", a.change.max_depth,
                 "metres that a cylinder reaches to either side; 0: 2, or four cylinders")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--registration-sigma", a.change.registration_sigma,
                 "metres, how well the two clouds lie on each other: part of the detection limit")
      ->check(non_negative_number())
      ->capture_default_str();
}

void add_arguments(App& app, Arguments& a) {
  app.add_option("estimate", a.estimate, "cloud, mesh, result folder, or a road (.crg, .xodr)")
      ->required();
  app.add_option("truth", a.truth, "cloud, mesh, result folder, scene, or a road (.crg, .xodr)")
      ->required();
  app.add_option("--out", a.out,
                 "folder for tables (JSON, CSV), coloured clouds (PLY) and pictures (PNG)")
      ->output_folder();
  app.add_flag("--overwrite", a.overwrite, "replace a foreign folder that is not empty");
  app.add_option("--thresholds", a.options.thresholds, "metres, for precision, recall and F-score")
      ->delimiter(',')
      ->capture_default_str();
  add_change_arguments(app, a);
  add_alignment_arguments(app, a);
  add_visibility_arguments(app, a);
  add_road_frame_arguments(app, a);
  add_confine_option(app, a.confine);
  add_cloud_arguments(app, a.reading);
  app.add_flag("--json", a.as_json, "one JSON object on stdout");
}

}  // namespace

void register_compare(App& root) {
  Command* command = add_command(
      root, "compare",
      "Measures an estimate against dense truth, both ways. Each may be a cloud, a PLY mesh or a "
      "result folder; truth may also be a scene with a truth cloud, "
      "or with true depth of the result's reference frame, whose ground is then the truth.",
      "  camber compare out/steep_hill samples/steep_hill --out comparison\n"
      "  camber compare estimate.ply truth.ply --thresholds 0.05,0.1,0.2 --json\n"
      "  camber compare estimate.ply truth_mesh.ply --align rigid --out comparison\n"
      "  camber compare later.las earlier.las --method m3c2 --registration-sigma 0.005 --out "
      "change\n"
      "  camber compare out/run scan.bin --estimate-from-truth camera_from_laser.txt "
      "--truth-viewpoint 0,0,0 --camera scene.json --farthest 40");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
