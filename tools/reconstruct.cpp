// camber reconstruct and camber triangulate: frames of one moving camera to a metric road.

#include "camber/pipeline/reconstruct_scene.h"

#include <fmt/format.h>

#include <cstdio>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/version.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/scene/evidence_json.h"
#include "camber/scene/findings.h"
#include "camber/scene/vehicle_table.h"
#include "command.h"
#include "network_arguments.h"
#include "own_inputs.h"
#include "scene_input.h"

namespace camber::tools {
namespace {

struct Arguments {
  std::string scene, out, frames, evidence, method = "joint", preset = "default", terms = "meant",
                                            scale = "ego";
  int keypoint_set = 36;
  ReconstructOptions options;
  NetworkArguments networks;
  SceneInputArguments input;     // of reconstruct
  bool places_vehicles = false;  // found by the shipped detector where a scene has no boxes
  bool no_pictures = false;
  bool no_masks = false;
  bool no_calibrate = false;
  bool confine = false;
  bool overwrite = false;
  bool json = false;
};

void add_frame_options(App& app, Arguments& a) {
  app.add_option("--frames", a.frames,
                 "frame ids: 48,49,50 or 48:52 (both ends), 0:10:5 or all, at most 64, of which "
                 "those too far from the reference to share much with it are left out; default: "
                 "the reference and two on each side (preset paper: one), as far away as it takes "
                 "to see the road move, or fewer where those give no answer. One frame: road and "
                 "metres by painted markings of known size (markings_m of the scene)")
      ->no_name();
  app.add_flag("--no-masks", a.no_masks,
               "do not read segmentations and road masks: find the road by geometry");
  add_calibrate_option(app, a.no_calibrate);
}

/// What a warning is about, before its text; the text of other codes stands alone.
const char* warned_of(const std::string& code) {
  if (code == "road_contradicted") return "the road: ";
  if (code == "gravity_contradicted") return "the level: ";
  if (code == "focal_length_contradicted") return "the focal length: ";
  return code == "scale_contradicted" ? "the scale: " : "";
}

/// Runs, and writes the evidence, where asked for, if there is no answer.
template <class Run>
SceneReconstruction with_evidence(const std::string& file, const Run& run) {
  if (file.empty()) return run();
  try {
    SceneReconstruction found = run();
    write_evidence(found.result.run.extra["evidence"], "", file);
    return found;
  } catch (const UnknownScaleError& error) {
    write_evidence(to_json(error.evidence()), error.what(), file);
    throw;
  } catch (const NoAnswerError& error) {
    write_evidence(nlohmann::json::array(), error.what(), file);
    throw;
  }
}

/// @param check_output  throws if the result cannot be written, once all that is read is protected.
/// @return the scene with what networks saw in it.
SceneReconstruction run(const Command& command, const Arguments& a, const Scene& scene,
                        const std::function<void()>& check_output) {
  ReconstructSceneOptions options;
  options.run = a.options;
  options.run.seed = command.common.seed;
  options.run.num_threads = command.common.threads;
  options.run.load.use_masks = !a.no_masks;
  options.networks = choice_of(a.networks);
  options.places_vehicles = a.places_vehicles;
  options.calibrates = !a.no_calibrate;
  options.warn = make_warning_sink(command.common);
  if (!command.common.quiet) {
    options.notice = [](const std::string& text) {
      std::fprintf(stderr, "camber: %s\n", text.c_str());
    };
  }
  std::vector<std::filesystem::path> inputs = files_of(scene);
  for (const std::filesystem::path& file : files_of(options.networks)) inputs.push_back(file);
  protect_inputs(inputs);
  check_output();
  if (!a.frames.empty()) options.frames = select_frames(scene, a.frames);
  SceneReconstruction out = reconstruct_scene(scene, options, make_progress(command.common));
  out.result.run.extra["command"] = command.common.command_line;
  return out;
}

/// What is missing or not to be relied on, in words.
void print_findings(const Reconstruction& result) {
  for (const Finding& finding : findings(result.run, &result.surface, &result.vehicles)) {
    if (!finding.complete) std::printf("%s\n", finding.text.c_str());
  }
}

/// A line a vehicle of the reference frame.
void print_vehicles(const Reconstruction& result) {
  for (const std::string& line : vehicle_lines(result.vehicles, result.reference_frame)) {
    std::printf("  %s\n", line.c_str());
  }
}

int print_json(const Reconstruction& result) {
  std::printf("%s\n", to_json(result.run).dump(2).c_str());
  return 0;
}

}  // namespace

void register_reconstruct(App& root) {
  Command* command = add_command(
      root, "reconstruct",
      "Turns a few frames of one moving camera into a metric road surface with vehicles on it: "
      "road cloud, planar patches, vehicles, pictures, a report to read (report.html), the scene "
      "as "
      "glTF (scene.glb); with ground truth in the scene also metrics.",
      "  camber reconstruct samples/steep_hill --out out/steep_hill\n"
      "  camber reconstruct drive.mp4 --height 1.3 --fov 70 --out out/drive\n"
      "  camber reconstruct clip/scene.json --frames 48:50 --method coplanar --out out/clip\n"
      "  camber reconstruct scene --detector yolox.onnx --segmenter road.onnx --out out/own\n"
      "  camber reconstruct samples/steep_hill --frames 1 --out out/one_image\n"
      "  camber reconstruct samples/steep_hill --preset paper --out out/paper");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  add_scene_input(app, a.input);
  add_frame_options(app, a);
  add_network_options(app, a.networks);
  app.add_option("--out", a.out, "result folder; an earlier result there is replaced")
      ->output_folder()
      ->required();
  app.add_option(
         "--method", a.method,
         "plane under the vehicles: joint (local patch), coplanar (ego plane), flat (level "
         "plane at the camera's height), reprojection (none: keypoints, boxes and the prior "
         "alone)")
      ->check(is_member({"joint", "coplanar", "flat", "reprojection"}))
      ->capture_default_str();
  app.add_option("--preset", a.preset,
                 "default, or paper: planes by RANSAC under each vehicle and the paper's joint "
                 "problem over all vehicles and planes of a frame; takes a single image too")
      ->check(is_member({"default", "paper"}))
      ->capture_default_str();
  app.add_option("--paper-terms", a.terms,
                 "of preset paper: meant, or printed: equations 4, 6 and 7 as the formulas stand")
      ->check(is_member({"meant", "printed"}))
      ->capture_default_str();
  app.add_option("--paper-scale", a.scale,
                 "of preset paper: ego: metres once, by the ego patch; patch: as printed, each "
                 "patch by the median of its points' y")
      ->check(is_member({"ego", "patch"}))
      ->capture_default_str();
  app.add_option("--keypoint-set", a.keypoint_set, "keypoints to use: 36 or 14")
      ->check(is_member({"36", "14"}))
      ->capture_default_str();
  app.add_option(
         "--evidence", a.evidence,
         "also write what each source knows of the scale (.json), where there is no answer, "
         "too")
      ->output_file();
  app.add_flag("--no-pictures", a.no_pictures, "write no PNG, no scene.glb and no report.html");
  app.add_flag("--overwrite", a.overwrite, "replace a folder that is no Camber result");
  app.add_flag("--json", a.json, "print run.json to stdout");
  command->run = [command, arguments] {
    Arguments& args = *arguments;
    args.options.vehicles.method = vehicle_method_from_string(args.method);
    args.options.vehicles.fit.keypoint_set = static_cast<KeypointSet>(args.keypoint_set);
    args.options.preset = preset_from_string(args.preset);
    if (args.options.preset != Preset::kPaper) {
      if (args.terms != "meant")
        throw UsageError("--paper-terms: expected --preset paper beside it");
      if (args.scale != "ego") throw UsageError("--paper-scale: expected --preset paper beside it");
    }
    args.options.paper.vehicles.terms = paper::terms_from_string(args.terms);
    args.options.paper.ground.scale = paper_scale_from_string(args.scale);
    args.places_vehicles = true;
    SceneInput input(*command, args.input, args.out);
    const auto check_outputs = [&] {
      check_output_folder(args.out, args.overwrite);
      if (!args.evidence.empty()) check_output_file(args.evidence);
    };
    SceneReconstruction found = with_evidence(
        args.evidence, [&] { return run(*command, args, input.opened().scene, check_outputs); });
    if (found.calibrated) input.recalibrate(std::move(*found.calibrated));
    Reconstruction& result = found.result;
    const Scene& scene = found.scene;
    result.run.scene = input.manifest().string();
    for (auto& [path, hash] : result.run.input_hashes) path = input.kept_name(path);
    WriteReconstructionOptions options;
    options.pictures = !args.no_pictures;
    options.overwrite = args.overwrite;
    options.num_threads = command->common.threads;
    options.inputs = files_of(scene);
    options.inputs.emplace_back(args.input.path);
    options.add_files = [&](const std::filesystem::path& staging) { input.keep_in(staging); };
    const std::string summary =
        write_reconstruction(scene, result, args.out, options, make_progress(command->common));
    for (const RunDocument::Warning& warning : result.run.warnings) {
      std::fprintf(stderr, "camber: warning: %s%s\n", warned_of(warning.code),
                   warning.text.c_str());
    }
    if (args.json) return print_json(result);
    if (!command->common.quiet) {
      std::size_t vehicles = 0;
      for (const VehicleFrame& frame : result.vehicles.frames) vehicles += frame.vehicles.size();
      std::printf("%s: %zu road points, %zu patches, %zu vehicles in %zu frames\n",
                  args.out.c_str(), result.cloud.size(), result.surface.patches.size(), vehicles,
                  result.vehicles.frames.size());
      print_vehicles(result);
      std::printf("%s\n", scale_sentence(result.run).c_str());
      print_findings(result);
      if (!summary.empty()) std::printf("%s", summary.c_str());
      if (!args.no_pictures) {
        std::printf("report: %s\n", (std::filesystem::path(args.out) / "report.html").c_str());
      }
    }
    return 0;
  };
}

void register_triangulate(App& root) {
  Command* command = add_command(
      root, "triangulate",
      "The road cloud alone: points of the road with their standard deviations along the viewing "
      "rays, in the reference camera's frame.",
      "  camber triangulate samples/steep_hill --out road.ply\n"
      "  camber triangulate clip/scene.json --frames 0:10:5 --no-masks --out road.pcd --json");
  auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  command->app->add_option("scene", a.scene, "scene manifest (scene.json) or its folder")
      ->required();
  add_frame_options(*command->app, a);
  add_confine_option(*command->app, a.confine);
  command->app
      ->add_option("--out", a.out, "cloud: .ply, .pcd, .bin, .xyz, .csv, .las, .laz or .copc.laz")
      ->output_file()
      ->required();
  command->app->add_flag("--json", a.json, "print what was done as JSON to stdout");
  command->run = [command, arguments] {
    Arguments& args = *arguments;
    if (!format_from_extension(args.out)) {
      throw UsageError("--out " + args.out +
                       ": unknown extension, expected .ply, .pcd, .bin, "
                       ".xyz, .csv, .las or .laz");
    }
    const Scene scene =
        read_scene(args.scene, make_warning_sink(command->common), scene_paths(args.confine));
    Reconstruction result = run(*command, args, scene, [&] { check_output_file(args.out); }).result;
    result.run.scene = std::filesystem::absolute(args.scene).lexically_normal().string();
    {
      const StageTimer timer(result.run.timings, "write");
      write_cloud(result.cloud, args.out);
    }
    if (args.json) return print_json(result);
    if (!command->common.quiet) {
      const std::string scale =
          result.surface.metric
              ? fmt::format("scale known to {:.1f} % (1 sigma)", 100.0 * result.surface.scale_sigma)
              : "up to scale";
      std::printf("%s: %zu road points, %s\n", args.out.c_str(), result.cloud.size(),
                  scale.c_str());
    }
    return 0;
  };
}

}  // namespace camber::tools
