// camber evaluate: the paper's tables and the errors of drives, from results and the truth of their
// scenes.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "camber/cloud/cloud_io.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/read_file.h"
#include "camber/core/version.h"
#include "camber/evaluate/scene_truth.h"
#include "camber/evaluate/strip_errors.h"
#include "camber/evaluate/tables.h"
#include "camber/evaluate/track_errors.h"
#include "camber/evaluate/trajectory_files.h"
#include "camber/pipeline/kitti_boxes.h"
#include "camber/render/result_plots.h"
#include "command.h"
#include "own_inputs.h"
#include "road_arguments.h"
#include "strip_input.h"

namespace camber::tools {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<std::string> truth, estimate;
  std::string subset, out, times;
  std::vector<fs::path> calibration;
  int camera = 2;
  std::vector<int> image_size{1242, 375};
  bool json = false, markdown = false, overwrite = false, confine = false;
};

/// Whether a path is a file of KITTI labels.
bool is_kitti(const fs::path& path) { return path.extension() == ".txt" && !is_trajectory(path); }

/// Whether a truth is poses alone.
bool is_pose_file(const std::string& truth) {
  return !fs::is_directory(truth) && is_trajectory(truth) && fs::path(truth).extension() != ".json";
}

KittiCalibration::Camera kitti_camera(const Arguments& args, const std::string& path) {
  if (args.calibration.empty()) {
    throw UsageError(path + ": a KITTI label file needs --calib, none is given");
  }
  return read_kitti_calibration(args.calibration).camera(args.camera);
}

/// Frame of a label file in the object form: the number that is its name, else 0.
int frame_of(const fs::path& path) {
  const std::string stem = path.stem().stem().string();
  const bool number =
      !stem.empty() && stem.size() < 9 && stem.find_first_not_of("0123456789") == std::string::npos;
  return number ? std::stoi(stem) : 0;
}

Scene read_truth(const Arguments& args, const std::string& truth, const LogSink& warn) {
  if (!is_kitti(truth)) return read_scene(truth, warn, scene_paths(args.confine));
  return truth_from_kitti(read_kitti_labels(truth), kitti_camera(args, truth), args.image_size[0],
                          args.image_size[1], frame_of(truth), fs::path(truth).stem().string());
}

VehicleDocument read_estimate(const Arguments& args, const std::string& estimate,
                              const SceneTruth& truth) {
  if (!is_kitti(estimate)) {
    return read_vehicles(fs::is_directory(estimate) ? fs::path(estimate) / "vehicles.json"
                                                    : fs::path(estimate));
  }
  const KittiLabelFile labels = read_kitti_labels(estimate);
  std::vector<BoxTilt> tilts;
  if (fs::exists(tilt_file(estimate))) {
    tilts = read_tilts(tilt_file(estimate), labels.labels.size());
  }
  const int frame = frame_of(estimate);
  VehicleDocument out = vehicles_from_kitti(labels, kitti_camera(args, estimate), frame, tilts,
                                            tilts.empty() ? "kitti boxes" : "kitti boxes, tilted");
  add_empty_frames(labels, frame, truth, &out);
  return out;
}

/// What a truth holds beside its errors.
struct TruthContents {
  std::map<int, double> times;            ///< s by frame id, where the scene gives all of them
  std::map<int, std::set<int>> vehicles;  ///< ids of the true vehicles by frame id
};

EvaluatedScene evaluate_vehicles_of(const Scene& scene, const std::string& estimate,
                                    const VehicleDocument& vehicles, TruthContents* contents) {
  std::map<int, double>& times = contents->times;
  for (const SceneFrame& frame : scene.frames) {
    if (frame.time_s) times[frame.id] = *frame.time_s;
  }
  if (times.size() < scene.frames.size()) times.clear();
  for (const TruthFrame& frame : scene.truth->frames) {
    std::set<int>& ids = contents->vehicles[frame.id];
    for (const TruthVehicle& vehicle : frame.vehicles) ids.insert(vehicle.id);
  }
  const bool folder = fs::is_directory(estimate);
  EvaluatedScene out;
  out.scene = scene.name;
  out.method = vehicles.method;
  out.preset = vehicles.preset;
  out.paper_terms = vehicles.paper_terms;
  out.detections_source = vehicles.detections_source;
  out.metric = vehicles.metric;
  if (folder && fs::exists(fs::path(estimate) / "surface.json") &&
      fs::exists(fs::path(estimate) / "run.json")) {
    out.metrics = evaluate_scene(scene, read_camera_surface(estimate), vehicles,
                                 read_run(fs::path(estimate) / "run.json"));
  } else {
    out.metrics = evaluate_vehicles(scene, vehicles);
  }
  return out;
}

/// A name without what a file's name should not hold.
std::string file_stem(const std::string& name) {
  std::string out = name;
  for (char& c : out) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_';
    if (!plain) c = '_';
  }
  return out.empty() ? "scene" : out;
}

/// Histograms of all vehicles, and depth over time of each scene with all its methods, by name.
/// @param truths  the truth of each of the scenes, as given.
std::map<std::string, Image> draw_all_plots(const std::vector<EvaluatedScene>& scenes,
                                            const std::vector<std::string>& truths,
                                            const std::vector<TruthContents>& contents) {
  std::map<std::string, Image> plots;
  const auto draw = [&](const std::string& name, const auto& make) {
    PlotSheet sheet;
    try {
      sheet = make();
    } catch (const NoAnswerError&) {
      return;  // nothing to plot: the tables state it
    }
    plots[name] = draw_plots(sheet);
  };
  draw("error_histogram.png", [&] { return error_plots(scenes, PlottedError::kCenter); });
  draw("height_histogram.png", [&] { return error_plots(scenes, PlottedError::kGround); });
  std::vector<std::string> done, names;
  for (const std::string& truth : truths) {
    if (std::find(done.begin(), done.end(), truth) != done.end()) continue;
    done.push_back(truth);
  }
  for (const std::string& truth : done) {
    std::vector<EvaluatedScene> methods;
    std::map<int, double> seconds;
    for (std::size_t i = 0; i < scenes.size(); ++i) {
      if (truths[i] != truth) continue;
      methods.push_back(scenes[i]);
      seconds = contents[i].times;
    }
    std::string name = "depth_over_time";
    if (done.size() > 1) {
      name += "_" + file_stem(methods.front().scene);
      const auto same = std::count(names.begin(), names.end(), name);
      names.push_back(name);
      if (same > 0) name += "_" + std::to_string(same + 1);
    }
    draw(name + ".png", [&] { return depth_plots(methods, seconds); });
  }
  return plots;
}

/// What of an estimate was judged by what of its truth.
struct Matched {
  std::string truth, estimate;
  std::size_t true_frames = 0, frames = 0, common_frames = 0;
  std::size_t detections = 0;  ///< in the common frames
  SceneMetrics counts;
};

Matched matched_of(const std::string& truth, const std::string& estimate, const Scene& scene,
                   const VehicleDocument& vehicles, const SceneMetrics& metrics) {
  Matched out;
  out.truth = truth;
  out.estimate = estimate;
  std::set<int> ids;
  for (const TruthFrame& frame : scene.truth->frames) ids.insert(frame.id);
  out.true_frames = ids.size();
  out.frames = vehicles.frames.size();
  for (const VehicleFrame& frame : vehicles.frames) {
    if (ids.count(frame.id) == 0) continue;
    ++out.common_frames;
    out.detections += frame.vehicles.size();
  }
  out.counts = metrics;
  return out;
}

nlohmann::json to_json(const Matched& m) {
  return {{"truth", m.truth},
          {"estimate", m.estimate},
          {"true_frames", m.true_frames},
          {"frames", m.frames},
          {"common_frames", m.common_frames},
          {"counted", m.counts.counted},
          {"matched", m.counts.vehicles.size()},
          {"missed", m.counts.missed},
          {"unanswered", m.counts.unanswered},
          {"in_frames_without_result", m.counts.unjudged},
          {"uncertain", m.counts.uncertain},
          {"detections", m.detections},
          {"detections_without_truth", m.detections - m.counts.vehicles.size()}};
}

std::string describe(const Matched& m) {
  std::string out =
      fmt::format("{} by {}: {} of {} true vehicles matched in {} frames", m.estimate, m.truth,
                  m.counts.vehicles.size(), m.counts.counted, m.common_frames);
  if (m.counts.unjudged > 0) {
    out += fmt::format(", {} more in frames without a result", m.counts.unjudged);
  }
  if (m.counts.uncertain > 0) {
    out += fmt::format(", {} left out since their truth is uncertain", m.counts.uncertain);
  }
  return out + fmt::format("; {} of {} detections match no true vehicle that counts\n",
                           m.detections - m.counts.vehicles.size(), m.detections);
}

/// All estimates beside their truths.
struct Evaluation {
  // Of estimates with vehicles; a row of each list belongs together.
  std::vector<EvaluatedScene> scenes;
  std::vector<std::string> truths;      ///< as given
  std::vector<TruthContents> contents;  ///< of the truths
  std::vector<Matched> matched;
  // Of drives.
  std::vector<EvaluatedTrajectory> trajectories;
  std::vector<EvaluatedTracks> tracks;
  std::vector<EvaluatedStrip> strips;
};

EvaluatedTrajectory evaluate_trajectory(const TrueTrajectory& truth, const std::string& estimate,
                                        const LogSink& warn) {
  const ComparedTrajectory compared = read_compared_trajectory(estimate, truth, warn);
  EvaluatedTrajectory out;
  out.truth = truth.name;
  out.estimate = estimate;
  out.method = compared.method;
  out.metric = compared.metric;
  out.frames_taken = compared.frames_taken;
  try {
    out.errors = trajectory_errors(compared.poses, compared.options);
  } catch (const NoAnswerError& error) {
    throw NoAnswerError(estimate + ": " + error.what());
  }
  return out;
}

/// The road of a drive in metres against the truth's cloud; none: either is not there.
std::optional<EvaluatedStrip> evaluate_strip(const Scene& scene, const std::string& truth,
                                             const std::string& estimate) {
  const fs::path folder = fs::path(estimate) / "strip";
  if (scene.truth->cloud.empty() || !is_strip(folder)) return std::nullopt;
  const StripIndex index = read_strip_index(folder);
  const auto posed =
      std::find_if(scene.truth->frames.begin(), scene.truth->frames.end(),
                   [](const TruthFrame& frame) { return frame.world_from_camera.has_value(); });
  if (!index.metric || posed == scene.truth->frames.end()) return std::nullopt;
  const SE3 world_from_cloud = *posed->world_from_camera * SE3::from_matrix(frame_from_truth_cloud(
                                                               scene.name, scene, posed->id));
  StripErrorOptions options;
  options.cell = index.cell;
  EvaluatedStrip out{truth, estimate, {}};
  try {
    out.errors =
        strip_errors(scene, read_drive(fs::path(estimate) / "drive.json"), read_strip(index),
                     read_cloud(scene.truth->cloud), world_from_cloud, options);
  } catch (const NoAnswerError& error) {
    throw NoAnswerError(estimate + ": " + error.what());
  }
  return out;
}

/// Adds one estimate's part to all.
/// @param warn_truth  receives what is to be known of the truth; may be empty
void evaluate_one(const Arguments& args, const std::string& truth, const std::string& estimate,
                  const LogSink& warn_truth, const LogSink& warn, Evaluation* all) {
  if (is_pose_file(truth)) {
    if (!is_trajectory(estimate)) {
      throw UsageError(estimate + ": is no trajectory, but " + truth + " holds poses alone");
    }
    all->trajectories.push_back(
        evaluate_trajectory(read_true_trajectory(truth, args.times), estimate, warn));
    return;
  }
  const Scene scene = read_truth(args, truth, warn_truth);
  protect_inputs(files_of(scene));
  if (!scene.truth) throw NoAnswerError(truth + ": the scene has no truth to compare with");
  const bool drive = is_trajectory(estimate);
  const bool vehicles_there = !drive || fs::exists(fs::path(estimate) / "vehicles.json");
  const auto& frames = scene.truth->frames;
  const bool poses = std::any_of(frames.begin(), frames.end(), [](const TruthFrame& frame) {
    return frame.world_from_camera.has_value();
  });
  const bool true_vehicles = std::any_of(frames.begin(), frames.end(), [](const TruthFrame& frame) {
    return !frame.vehicles.empty();
  });
  // A drive's poses and vehicles are evaluated as far as the truth has them.
  if (drive && (poses || !vehicles_there || !true_vehicles)) {
    all->trajectories.push_back(evaluate_trajectory(true_trajectory(scene, truth), estimate, warn));
  }
  if (drive && poses) {
    if (auto strip = evaluate_strip(scene, truth, estimate)) all->strips.push_back(*strip);
  }
  if (drive && (!vehicles_there || !true_vehicles)) return;
  const VehicleDocument vehicles = read_estimate(args, estimate, *scene.truth);
  TruthContents contents;
  EvaluatedScene evaluated = evaluate_vehicles_of(scene, estimate, vehicles, &contents);
  const bool tracked =
      std::any_of(vehicles.frames.begin(), vehicles.frames.end(), [](const VehicleFrame& frame) {
        return std::any_of(frame.vehicles.begin(), frame.vehicles.end(),
                           [](const VehicleEstimate& vehicle) { return vehicle.track >= 0; });
      });
  if (tracked) {
    all->tracks.push_back({truth, estimate, evaluated.method, track_errors(scene, vehicles)});
  }
  all->matched.push_back(matched_of(truth, estimate, scene, vehicles, evaluated.metrics));
  all->truths.push_back(truth);
  all->contents.push_back(std::move(contents));
  all->scenes.push_back(std::move(evaluated));
}

Evaluation evaluate_all(const Arguments& args, const LogSink& warn) {
  Evaluation all;
  std::map<std::pair<std::string, std::string>, std::string> by_label;  // of a truth and a method
  for (std::size_t i = 0; i < args.estimate.size(); ++i) {
    throw_if_interrupted();
    const std::string& truth = args.truth[i % args.truth.size()];
    const std::string& estimate = args.estimate[i];
    const std::size_t before = all.scenes.size();
    // The same truth is read for every method; unknown keys need one warning.
    const bool first_time = i < args.truth.size();
    evaluate_one(args, truth, estimate, first_time ? warn : LogSink{}, warn, &all);
    if (!warn || all.scenes.size() == before) continue;
    const EvaluatedScene& scene = all.scenes.back();
    if (!scene.metric) warn(estimate + ": the result is up to scale");
    const std::string label = method_label(scene.method, scene.preset, scene.paper_terms);
    const auto [first, fresh] = by_label.emplace(std::make_pair(truth, label), estimate);
    if (!fresh) {
      warn(fmt::format("{}: is of the method {} as {} is, for the same truth: one table joins them",
                       estimate, label, first->second));
    }
  }
  return all;
}

std::string ids_of(const std::set<int>& ids) {
  return ids.empty() ? "none" : fmt::format("{}", fmt::join(ids, ", "));
}

/// @throws InputError for an entry that is in no truth.
void check_subset(const std::string& path, const std::vector<SubsetEntry>& subset,
                  const Evaluation& all) {
  std::map<std::string, std::map<int, std::set<int>>> truths;
  for (std::size_t i = 0; i < all.scenes.size(); ++i) {
    auto& frames = truths[all.scenes[i].scene];
    for (const auto& [id, vehicles] : all.contents[i].vehicles) {
      frames[id].insert(vehicles.begin(), vehicles.end());
    }
  }
  for (const SubsetEntry& entry : subset) {
    const auto refuse = [&](const std::string& reason) {
      throw InputError(path, fmt::format("line {}", entry.line), reason);
    };
    const auto scene = truths.find(entry.scene);
    if (scene == truths.end()) {
      std::set<std::string> names;
      for (const auto& [name, frames] : truths) names.insert(name);
      refuse(fmt::format("found \"{}\", expected the name of a scene of --truth: {}",
                         printable(entry.scene), fmt::join(names, ", ")));
    }
    if (entry.frame < 0) continue;
    const auto frame = scene->second.find(entry.frame);
    if (frame == scene->second.end()) {
      std::set<int> ids;
      for (const auto& [id, vehicles] : scene->second) ids.insert(id);
      refuse(fmt::format("found frame {}, expected a frame of the truth of {}: {}", entry.frame,
                         printable(entry.scene), ids_of(ids)));
    }
    if (entry.vehicle >= 0 && frame->second.count(entry.vehicle) == 0) {
      refuse(fmt::format("found vehicle {}, expected a true vehicle of frame {}: {}", entry.vehicle,
                         entry.frame, ids_of(frame->second)));
    }
  }
}

std::string tables_of(const std::vector<MethodTables>& tables, const Evaluation& all,
                      bool markdown) {
  std::string out = trajectory_text(all.trajectories, markdown);
  for (const std::string& part :
       {markdown ? tables_markdown(tables) : tables_text(tables), tracks_text(all.tracks, markdown),
        strips_text(all.strips, markdown)}) {
    if (markdown && !out.empty() && !part.empty()) out += "\n";
    out += part;
  }
  return out;
}

/// @param json  the tables, with the options that made them.
void write_folder(const Command& command, const Arguments& args, const Evaluation& all,
                  const std::vector<MethodTables>& tables, const nlohmann::json& json,
                  const Timings& timings) {
  // Before the folder is there: where VTK's text has no memory, it may end the program.
  const std::map<std::string, Image> plots = draw_all_plots(all.scenes, all.truths, all.contents);
  AtomicFolder folder(args.out, args.overwrite);
  write_file_atomically(folder.staging() / "tables.md", tables_of(tables, all, true));
  if (!all.scenes.empty()) {
    write_file_atomically(folder.staging() / "vehicles.csv", vehicles_csv(all.scenes));
  }
  write_json(json, folder.staging() / "tables.json");
  for (const auto& [name, plot] : plots) write_png(plot, folder.staging() / name);
  RunDocument run;
  run.seed = command.common.seed;
  run.options = json["options"];
  run.timings = timings;
  run.extra["command"] = command.common.command_line;
  write_json(to_json(run), folder.staging() / "run.json");
  folder.commit();
}

int run(const Command& command, const Arguments& args) {
  if (args.estimate.size() % args.truth.size() != 0) {
    throw UsageError("--estimate: " + std::to_string(args.estimate.size()) + " given for " +
                     std::to_string(args.truth.size()) + " truths, expected as many or a multiple");
  }
  Timings timings;
  StageTimer load(timings, "load");
  std::vector<SubsetEntry> subset;
  if (!args.subset.empty()) subset = read_subset(args.subset);
  const Evaluation all = evaluate_all(args, make_warning_sink(command.common));
  check_subset(args.subset, subset, all);
  load.stop();
  StageTimer compute(timings, "compute");
  const std::vector<MethodTables> tables = make_tables(all.scenes, subset);
  compute.stop();
  int counted = 0;
  for (const MethodTables& table : tables) counted += table.counted;
  if (counted == 0 && all.trajectories.empty())
    throw NoAnswerError("no true vehicle counts in the frames of the results");
  nlohmann::json json = {
      {"version", kVersion},
      {"seed", command.common.seed},
      {"options", {{"truth", args.truth}, {"estimate", args.estimate}, {"subset", args.subset}}},
      {"tables", tables_json(tables)}};
  for (const EvaluatedTrajectory& one : all.trajectories) {
    json["trajectories"].push_back(to_json(one));
  }
  for (const EvaluatedTracks& one : all.tracks) json["tracks"].push_back(to_json(one));
  for (const EvaluatedStrip& one : all.strips) json["strips"].push_back(to_json(one));
  for (const Matched& one : all.matched) json["matched"].push_back(to_json(one));
  add_other_options(command, &json["options"]);
  if (!args.out.empty()) {
    const StageTimer write(timings, "write");
    write_folder(command, args, all, tables, json, timings);
  }
  if (args.json) {
    for (const auto& [stage, milliseconds] : timings.stages()) {
      json["timings_ms"][stage] = milliseconds;
    }
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    std::printf("%s", tables_of(tables, all, args.markdown).c_str());
    if (!args.markdown) {
      for (const Matched& one : all.matched) std::printf("%s", describe(one).c_str());
    }
  }
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  app.add_option(
         "--truth", a.truth,
         "scene manifests (or their folders) with truth, KITTI label files (.txt), or files "
         "of poses (KITTI, TUM)")
      ->required();
  app.add_option("--estimate", a.estimate,
                 "result folders (of drives, too), vehicles.json, drive.json, trajectories (TUM, "
                 "KITTI), or "
                 "KITTI label files (.txt; tilts from their .tilt.csv, if there is one)")
      ->required();
  app.add_option("--times", a.times,
                 "file of one time a row, s, of a --truth of poses without times, as KITTI's "
                 "times.txt");
  app.add_option("--calib", a.calibration, "KITTI calibration file(s), for label files");
  app.add_option("--camera", a.camera, "camera of the label files' images")
      ->check(in_range(0, 3))
      ->capture_default_str();
  app.add_option("--image-size", a.image_size, "width,height of the label files' images, px")
      ->delimiter(',')
      ->expected(2)
      ->check(positive_number())
      ->capture_default_str();
  add_confine_option(app, a.confine);
  app.add_option("--subset", a.subset,
                 "file that names a subset for a row of its own, a line each: scene [frame "
                 "[truth id]]");
  app.add_option("--out", a.out,
                 "folder for tables.md, tables.json, vehicles.csv and plots: error_histogram.png, "
                 "height_histogram.png, depth_over_time.png (one a scene)")
      ->output_folder();
  app.add_flag("--overwrite", a.overwrite, "replace a folder that is no Camber result");
  app.add_flag("--markdown", a.markdown, "print Markdown tables instead of plain text");
  app.add_flag("--json", a.json, "print the tables as JSON");
}

}  // namespace

void register_evaluate(App& root) {
  Command* command = add_command(
      root, "evaluate",
      "The paper's tables: 3D localisation error of the vehicles by distance, recall, plane height "
      "and normal under each vehicle, yaw, and whether the stated uncertainty holds. Of drives and "
      "trajectories: KITTI's odometry measure, the length of the whole and of windows of 50 "
      "frames, "
      "ATE and RPE (joined at the first frame, aligned rigidly, and with scale), and CLEAR MOT "
      "measures of the tracks; where the truth has a cloud, of the road along the drive. Estimates "
      "are "
      "paired with truths in order; with more estimates than truths (several methods), the truths "
      "start over.",
      "  camber evaluate --truth samples/steep_hill --estimate out/steep_hill\n"
      "  camber evaluate --truth a/scene.json b/scene.json --estimate a_joint b_joint a_flat "
      "b_flat --out tables\n"
      "  camber evaluate --truth label_02/0009.txt --estimate lifted.txt --calib calib/0009.txt\n"
      "  camber evaluate --truth drive/scene.json --estimate out/drive\n"
      "  camber evaluate --truth poses/03.txt --times 03/times.txt --estimate trajectory.tum "
      "--json");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
