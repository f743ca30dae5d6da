// camber vehicles: vehicles alone, from given detections, keypoints and planes.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/pipeline/estimate_vehicles.h"
#include "camber/pipeline/kitti_boxes.h"
#include "command.h"
#include "own_inputs.h"
#include "road_arguments.h"
#include "unknown_scale.h"

namespace camber::tools {
namespace {

struct Arguments {
  std::string scene, out, kitti_labels, frames, prior, surface, method = "joint",
                                                                preset = "default", terms = "meant";
  EstimateVehiclesOptions options;
  std::vector<std::filesystem::path> calibration;
  int camera = 2, keypoint_set = 36;
  bool no_tracks = false;
  bool json = false;
  bool confine = false;
};

/// A surface holds the frames of its own run only.
void require_common_frames(const std::string& folder, const RunDocument& run,
                           const std::vector<int>& frames, const LogSink& warn) {
  std::string missing;
  std::size_t count = 0;
  for (const int frame : frames) {
    const bool known = std::any_of(run.cameras.begin(), run.cameras.end(),
                                   [&](const RunDocument::CameraPose& c) { return c.id == frame; });
    if (known) continue;
    ++count;
    missing += (missing.empty() ? "" : ", ") + std::to_string(frame);
  }
  if (count == frames.size()) {
    throw UsageError("--surface " + folder + ": its run has none of the frames " + missing);
  }
  if (count > 0 && warn) {
    warn(folder + ": its run has no frame " + missing +
         ": vehicles there stand on planes of the scene");
  }
}

std::vector<std::filesystem::path> outputs_of(const Arguments& args) {
  std::vector<std::filesystem::path> outputs = {args.out, args.kitti_labels};
  if (!args.kitti_labels.empty()) outputs.push_back(tilt_file(args.kitti_labels));
  return outputs;
}

/// What the estimate is made from. The options point into it.
struct Inputs {
  Scene scene;
  std::vector<int> frames;  ///< ids
  VehiclePrior prior;
  RoadSurface surface;
  RunDocument run;
  Eigen::Vector3d camera_offset = Eigen::Vector3d::Zero();  ///< m, of --calib
};

void load(const Command& command, const Arguments& args, Inputs* in) {
  const LogSink warn = make_warning_sink(command.common);
  in->scene = read_scene(args.scene, warn, scene_paths(args.confine));
  refuse_own_inputs(outputs_of(args), files_of(in->scene));
  in->frames = select_frames(in->scene, args.frames);
  if (!args.surface.empty()) {
    in->surface = read_camera_surface(args.surface);
    in->run = read_run(std::filesystem::path(args.surface) / "run.json");
    require_common_frames(args.surface, in->run, in->frames, warn);
  }
  if (!args.calibration.empty()) {
    in->camera_offset = read_kitti_calibration(args.calibration).camera(args.camera).offset;
  }
  if (!args.prior.empty()) in->prior = read_vehicle_prior(args.prior);
}

/// @param in  must outlive the options.
EstimateVehiclesOptions options_of(const Command& command, const Arguments& args,
                                   const Inputs& in) {
  EstimateVehiclesOptions options = args.options;
  if (!args.surface.empty()) {
    options.surface = &in.surface;
    options.cameras = &in.run.cameras;
  }
  if (!args.prior.empty()) options.vehicles.fit.prior = &in.prior;
  options.vehicles.method = vehicle_method_from_string(args.method);
  options.vehicles.num_threads = command.common.threads;
  options.vehicles.fit.keypoint_set = static_cast<KeypointSet>(args.keypoint_set);
  options.vehicles.tracks = !args.no_tracks;
  options.preset = preset_from_string(args.preset);
  if (options.preset != Preset::kPaper && args.terms != "meant") {
    throw UsageError("--paper-terms: expected --preset paper beside it");
  }
  options.paper.terms = paper::terms_from_string(args.terms);
  return options;
}

/// The result, and KITTI's form of it where that is wanted.
void write(const Arguments& args, const Inputs& in, const VehicleDocument& document,
           const nlohmann::json& json) {
  AtomicFiles files;
  const std::filesystem::path result_file = files.stage(args.out);
  if (!args.kitti_labels.empty()) {
    const std::vector<LiftedBox> rows = kitti_from_vehicles(document, in.scene, in.camera_offset);
    KittiLabelFile file{KittiLabelForm::kTracking, {}};
    for (const LiftedBox& row : rows) file.labels.push_back(row.label);
    write_tilts(rows, files.stage(tilt_file(args.kitti_labels)));
    write_kitti_labels(file, files.stage(args.kitti_labels));
  }
  write_json(json, result_file);
  files.commit();
}

/// The result with how it was made, on stdout.
void print_json(const Command& command, const Arguments& args, const std::vector<int>& frames,
                const Timings& timings, nlohmann::json json) {
  const stages::VehicleOptions& options = args.options.vehicles;
  json["version"] = kVersion;
  json["seed"] = command.common.seed;
  json["options"] = {{"method", args.method},
                     {"frames", frames},
                     {"surface", args.surface},
                     {"tracks", !args.no_tracks},
                     {"preset", args.preset},
                     {"paper_terms", args.terms},
                     {"keypoint_set", args.keypoint_set},
                     {"given_sigma_height", options.support.given_sigma_height},
                     {"given_sigma_tilt", options.support.given_sigma_tilt},
                     {"prior", args.prior.empty() ? "shipped" : args.prior}};
  for (const auto& [stage, milliseconds] : timings.stages()) {
    json["timings_ms"][stage] = milliseconds;
  }
  std::printf("%s\n", json.dump(2).c_str());
}

void print_summary(const std::string& out, const VehicleDocument& document) {
  int count = 0, trusted = 0;
  for (const VehicleFrame& frame : document.frames) {
    for (const VehicleEstimate& v : frame.vehicles) {
      ++count;
      trusted += v.status == Status::kOk ? 1 : 0;
    }
  }
  std::printf("%s: %d vehicles in %zu frames, %d of them ok\n", out.c_str(), count,
              document.frames.size(), trusted);
}

int run(const Command& command, const Arguments& args) {
  if (!args.calibration.empty() && args.kitti_labels.empty()) {
    throw UsageError("--calib says in which frame --kitti-labels are written; give both");
  }
  Timings timings;
  StageTimer load_timer(timings, "load");
  Inputs in;
  load(command, args, &in);
  load_timer.stop();
  std::vector<SceneFrame> frames;
  for (const int id : in.frames) frames.push_back(*in.scene.find_frame(id));
  const EstimateVehiclesOptions options = options_of(command, args, in);
  const LogSink warn = make_warning_sink(command.common);
  if (warn) {
    for (const std::string& text : unknown_classes(frames, options.vehicles.fit.prior)) warn(text);
  }
  StageTimer compute(timings, "compute");
  const VehicleDocument document =
      estimate_vehicles(in.scene, in.frames, options, make_progress(command.common));
  compute.stop();
  if (!args.kitti_labels.empty()) {
    warn_of_unknown_scale(args.kitti_labels, document.metric, {}, warn);
  }
  const nlohmann::json json = to_json(document);
  StageTimer write_timer(timings, "write");
  write(args, in, document, json);
  write_timer.stop();
  if (args.json) {
    print_json(command, args, in.frames, timings, json);
  } else if (!command.common.quiet) {
    print_summary(args.out, document);
  }
  return 0;
}

/// The scene, what is written, and from what planes and frames.
void add_input_arguments(App& app, Arguments& a) {
  app.add_option("scene", a.scene, "scene manifest (scene.json) or its folder")->required();
  add_confine_option(app, a.confine);
  app.add_option("--out", a.out, "result file (vehicles.json form)")->output_file()->required();
  app.add_option("--kitti-labels", a.kitti_labels,
                 "also write a KITTI label file (tracking form), pitch and roll in a side file "
                 "with the extension .tilt.csv; in the frame of the scene's camera, or of "
                 "camera 0 with --calib")
      ->output_file();
  app.add_option("--calib", a.calibration, "KITTI calibration file(s), for --kitti-labels");
  app.add_option("--camera", a.camera, "the scene's camera in that calibration")
      ->check(in_range(0, 3))
      ->capture_default_str();
  app.add_option(
         "--method", a.method,
         "joint (own planes, weighed by how well they are known), coplanar (ego plane for "
         "all), flat (level plane at the camera's height), reprojection (no plane: keypoints, "
         "boxes and the prior alone)")
      ->check(is_member({"joint", "coplanar", "flat", "reprojection"}))
      ->capture_default_str();
  app.add_option("--frames", a.frames, "frame ids: 48,49,50, 48:52, 0:10:5 or all; default: all")
      ->no_name();
  app.add_option("--keypoint-set", a.keypoint_set, "keypoints to use: 36 or 14")
      ->check(is_member({"36", "14"}))
      ->capture_default_str();
  app.add_option("--given-sigma-height", a.options.vehicles.support.given_sigma_height,
                 "m, standard deviation of a given plane's height")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option("--given-sigma-tilt", a.options.vehicles.support.given_sigma_tilt,
                 "rad, standard deviation of a given plane's tilt")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option(
      "--surface", a.surface,
      "result folder of reconstruct: planes and poses from there; vehicles seen in several "
      "frames are then solved with one shape");
  app.add_flag("--no-tracks", a.no_tracks, "each frame by itself even where the poses are known");
}

/// How it is solved.
void add_solver_arguments(App& app, Arguments& a) {
  app.add_option(
         "--preset", a.preset,
         "default, or paper: the paper's own starts and joint problem over all vehicles and "
         "planes of a frame, with hand-set weights; frame by frame")
      ->check(is_member({"default", "paper"}))
      ->capture_default_str();
  app.add_option("--paper-terms", a.terms,
                 "of preset paper: meant, or printed: equations 4, 6 and 7 as the formulas stand")
      ->check(is_member({"meant", "printed"}))
      ->capture_default_str();
  app.add_option("--prior", a.prior, "vehicle prior file; default: the shipped one");
  app.add_flag("--json", a.json, "print the result with options and timings to stdout");
}

}  // namespace

void register_vehicles(App& root) {
  Command* command = add_command(
      root, "vehicles",
      "Vehicles alone, from a scene's detections, keypoints and planes; no images are needed. A "
      "vehicle without a plane of its own stands on the frame's ego plane, or on a level one at "
      "the camera's height.",
      "  camber vehicles samples/steep_hill --out vehicles.json\n"
      "  camber vehicles clip/scene.json --surface out/clip --out joined.json\n"
      "  camber vehicles clip/scene.json --out vehicles.json --kitti-labels labels.txt\n"
      "  camber vehicles samples/steep_hill --preset paper --out paper.json\n"
      "  camber vehicles clip/scene.json --frames 48:50 --method flat --out flat.json --json");
  const auto arguments = std::make_shared<Arguments>();
  add_input_arguments(*command->app, *arguments);
  add_solver_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
