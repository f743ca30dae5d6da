// camber keypoints run and evaluate: the keypoint network on crops and on scenes.

#include "keypoint_network.h"

#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/image/image_io.h"
#include "camber/pipeline/find_keypoints.h"
#include "camber/pipeline/keypoint_truth.h"
#include "camber/pipeline/network_file.h"
#include "camber/render/plot.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"
#include "own_inputs.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  std::vector<std::string> inputs;
  std::string network = kShippedNetwork, config, out, plot;
  KeypointTruthOptions truth;
  std::size_t first = 0;  ///< crops of a folder; 0: all
  bool json = false, confine = false;
};

bool is_crops(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path / "images.npy", ignored);
}

std::size_t most_of(const Arguments& a) {
  return a.first > 0 ? a.first : std::numeric_limits<std::size_t>::max();
}

json network_of(const Arguments& a, const KeypointNetwork& network) {
  return {{"file", a.network},
          {"hash", network.network().hash()},
          {"name", network.description().name},
          {"layers", network.network().layers()}};
}

json rows_of(const std::vector<KeypointObservation>& keypoints, json* sigmas) {
  json rows = json::array();
  *sigmas = json::array();
  for (const KeypointObservation& k : keypoints) {
    rows.push_back({number_json(k.pixel.x()), number_json(k.pixel.y()), number_json(k.confidence)});
    sigmas->push_back(number_json(k.sigma));
  }
  return rows;
}

/// Of a folder's crops, in px of the crop as it is there.
json found_in_crops(const Arguments& a, const fs::path& folder, const KeypointNetwork& network,
                    int threads, Timings* timings) {
  StageTimer load(*timings, "load");
  std::vector<Image> crops;
  int size = kKeypointCropSize;
  for (KeypointCropTruth& crop : read_keypoint_crops(folder, network.crop_size(), most_of(a))) {
    size = crop.stored_size;
    crops.push_back(std::move(crop.crop));
  }
  load.stop();
  StageTimer compute(*timings, "compute");
  const std::vector<PredictedKeypoints> found = network.predict(crops, threads);
  compute.stop();
  json out = json::array();
  const KeypointCrop itself{Eigen::Vector2d::Constant(0.5 * (size - 1)), static_cast<double>(size),
                            kKeypointCropSize};
  for (const PredictedKeypoints& keypoints : found) {
    json sigmas, rows = rows_of(to_observations(keypoints, itself), &sigmas);
    out.push_back({{"keypoints", std::move(rows)}, {"keypoint_sigmas_px", std::move(sigmas)}});
  }
  return out;
}

/// Of a scene's boxes, in px of the images.
json found_in_scene(const Command& command, const Arguments& a, const fs::path& path,
                    Timings* timings) {
  StageTimer load(*timings, "load");
  const LogSink warn = make_warning_sink(command.common);
  Scene scene = read_scene(path, warn, scene_paths(a.confine));
  protect_inputs(files_of(scene));
  load.stop();
  const StageTimer compute(*timings, "compute");
  FindKeypointsOptions options;
  options.choice = KeypointChoice::kAll;
  options.network = a.network;
  options.config = a.config;
  options.num_threads = command.common.threads;
  const auto use = find_keypoints(&scene, select_frames(scene, ""), options,
                                  make_progress(command.common), warn);
  if (!use) throw NoAnswerError(path.string() + ": no vehicle with a box and a keypoint shape");
  json frames = json::array();
  for (const SceneFrame& frame : scene.frames) {
    json vehicles = json::array();
    for (const VehicleDetection& vehicle : frame.vehicles) {
      if (vehicle.keypoints.empty()) continue;
      json sigmas, rows = rows_of(vehicle.keypoints, &sigmas);
      vehicles.push_back({{"id", vehicle.id},
                          {"box", {vehicle.box.x1, vehicle.box.y1, vehicle.box.x2, vehicle.box.y2}},
                          {"keypoints", std::move(rows)},
                          {"keypoint_sigmas_px", std::move(sigmas)}});
    }
    frames.push_back({{"id", frame.id}, {"vehicles", std::move(vehicles)}});
  }
  return frames;
}

void add_timings(const Timings& timings, json* out) {
  (*out)["timings_ms"] = json::object();
  for (const auto& [stage, ms] : timings.stages()) (*out)["timings_ms"][stage] = ms;
}

/// What both commands write.
json document(const Command& command, const Arguments& a, const KeypointNetwork& network) {
  return {{"version", kVersion},
          {"seed", command.common.seed},
          {"options", {{"inputs", a.inputs}, {"keypoints", a.network}, {"first", a.first}}},
          {"network", network_of(a, network)}};
}

void give(const Arguments& a, const json& out) {
  if (!a.out.empty()) write_json(out, a.out);
  if (a.json) {
    std::printf("%s\n", out.dump(2, ' ', false, json::error_handler_t::replace).c_str());
  }
}

void refuse_inputs(const Arguments& a) {
  std::vector<fs::path> description;
  if (a.network != kShippedNetwork) description.push_back(side_file_of(a.network, a.config));
  refuse_own_inputs({a.out, a.plot}, description);
}

int run(const Command& command, const Arguments& a) {
  if (a.out.empty() && !a.json) throw UsageError("keypoints run: expected --out or --json");
  refuse_inputs(a);
  Timings timings;
  const KeypointNetwork network =
      open_keypoint_network(a.network, a.config, make_warning_sink(command.common));
  json out = document(command, a, network);
  const fs::path input = a.inputs.front();
  if (is_crops(input)) {
    out["crops"] = found_in_crops(a, input, network, command.common.threads, &timings);
  } else {
    out["frames"] = found_in_scene(command, a, input, &timings);
  }
  add_timings(timings, &out);
  give(a, out);
  return 0;
}

json errors_json(const KeypointErrors& e) {
  json inside = json::array();
  for (const double share : e.inside_sigmas) inside.push_back(number_json(share));
  return {{"count", e.count},
          {"pck_2px", number_json(e.pck_2px)},
          {"pck_alpha", number_json(e.pck_alpha)},
          {"median_px", number_json(e.median)},
          {"offset_px", {number_json(e.offset.x()), number_json(e.offset.y())}},
          {"inside_sigmas", std::move(inside)}};
}

json groups_json(const std::vector<KeypointGroup>& groups) {
  json out = json::array();
  for (const KeypointGroup& g : groups) {
    out.push_back({{"name", g.name},
                   {"visible", errors_json(g.visible)},
                   {"hidden", errors_json(g.hidden)},
                   {"all", errors_json(g.all)}});
  }
  return out;
}

json evaluation_json(const KeypointEvaluation& e) {
  json apk = json::array(), visible = json::array();
  for (const double value : e.apk) apk.push_back(number_json(value));
  for (const double value : e.visible_by_probability) visible.push_back(number_json(value));
  return {{"crops", e.crops},
          {"overall", groups_json({e.overall})[0]},
          {"by_keypoint", groups_json(e.by_keypoint)},
          {"by_height", groups_json(e.by_height)},
          {"by_heading", groups_json(e.by_heading)},
          {"apk", std::move(apk)},
          {"mean_apk", number_json(e.mean_apk)},
          {"visibility_right", number_json(e.visibility_right)},
          {"visible_by_probability", std::move(visible)}};
}

/// PCK by keypoint, and how often what is stated to be visible is.
PlotSheet evaluation_plots(const KeypointEvaluation& e) {
  PlotSheet sheet;
  Plot pck;
  pck.title = "Keypoints within 2 px of 64, %";
  pck.x.title = "keypoint";
  pck.x.whole = true;
  pck.y = {"%", 0.0, 100.0, false, false, false, {}};
  PlotSeries visible, hidden;
  visible.kind = hidden.kind = PlotSeries::Kind::kPoints;
  visible.name = "visible";
  hidden.name = "hidden";
  visible.color = plot_color(0);
  hidden.color = plot_color(1);
  hidden.marker = 1;
  for (std::size_t k = 0; k < e.by_keypoint.size(); ++k) {
    visible.x.push_back(static_cast<double>(k));
    hidden.x.push_back(static_cast<double>(k));
    visible.y.push_back(100.0 * e.by_keypoint[k].visible.pck_2px);
    hidden.y.push_back(100.0 * e.by_keypoint[k].hidden.pck_2px);
  }
  pck.series = {visible, hidden};
  Plot reliability;
  reliability.title = "Visible, by the stated probability";
  reliability.x = {"stated, %", 0.0, 100.0, false, false, false, {}};
  reliability.y = {"visible, %", 0.0, 100.0, false, false, false, {}};
  PlotSeries diagonal, found;
  diagonal.x = diagonal.y = {0.0, 100.0};
  diagonal.dashed = true;
  diagonal.color = plot_color(2);
  found.kind = PlotSeries::Kind::kPoints;
  found.color = plot_color(0);
  for (std::size_t b = 0; b < e.visible_by_probability.size(); ++b) {
    found.x.push_back(10.0 * static_cast<double>(b) + 5.0);
    found.y.push_back(100.0 * e.visible_by_probability[b]);
  }
  reliability.series = {diagonal, found};
  sheet.panels = {pck, reliability};
  return sheet;
}

int evaluate(const Command& command, const Arguments& a) {
  refuse_inputs(a);
  require_png("--plot", a.plot);
  const LogSink warn = make_warning_sink(command.common);
  Timings timings;
  const KeypointNetwork network = open_keypoint_network(a.network, a.config, warn);
  StageTimer load(timings, "load");
  std::vector<KeypointCropTruth> crops;
  for (const std::string& input : a.inputs) {
    std::vector<KeypointCropTruth> more;
    if (is_crops(input)) {
      more = read_keypoint_crops(input, network.crop_size(), most_of(a));
    } else {
      const Scene scene = read_scene(input, warn, scene_paths(a.confine));
      protect_inputs(files_of(scene));
      KeypointTruthOptions options = a.truth;
      options.num_threads = command.common.threads;
      options.crop_size = network.crop_size();
      const fs::path folder =
          fs::is_directory(input) ? fs::path(input) : fs::path(input).parent_path();
      more = scene_keypoint_truth(scene, folder, options, warn).crops;
    }
    std::move(more.begin(), more.end(), std::back_inserter(crops));
  }
  load.stop();
  if (crops.empty()) throw NoAnswerError("no vehicle with true keypoints counts in the inputs");
  StageTimer compute(timings, "compute");
  std::vector<Image> images;
  images.reserve(crops.size());
  for (KeypointCropTruth& crop : crops) images.push_back(std::move(crop.crop));
  const KeypointEvaluation result =
      evaluate_keypoints(crops, network.predict(images, command.common.threads));
  compute.stop();
  if (!a.plot.empty()) write_png(draw_plots(evaluation_plots(result)), a.plot);
  json out = document(command, a, network);
  out["evaluation"] = evaluation_json(result);
  add_timings(timings, &out);
  give(a, out);
  if (!a.json) std::printf("%s", keypoint_table(result).c_str());
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  app.add_option("--keypoints", a.network,
                 "the network: shipped, or an ONNX file, described by a .json of the same name")
      ->capture_default_str();
  app.add_option("--keypoints-config", a.config, "the description, where it is another file");
  app.add_option("--first", a.first, "only so many crops of a folder, its first ones; 0: all")
      ->capture_default_str();
  app.add_flag("--json", a.json, "print the result as JSON to stdout");
  add_confine_option(app, a.confine);
}

}  // namespace

void add_keypoint_network_commands(App& keypoints) {
  const auto ran = std::make_shared<Arguments>(), judged = std::make_shared<Arguments>();
  Command* run_command = add_command(
      keypoints, "run",
      "Runs the keypoint network on the crops of `keypoints synthesise` or on the boxes of a "
      "scene: "
      "36 rows of u, v and the probability of being visible, and their standard deviations.",
      "  camber keypoints run scene --out keypoints.json\n"
      "  camber keypoints run crops --keypoints own.onnx --json");
  run_command->app->add_option("input", ran->inputs, "folder of crops, or scene manifest or folder")
      ->required()
      ->expected(1);
  run_command->app->add_option("--out", ran->out, "file to write (.json)")->output_file();
  add_arguments(*run_command->app, *ran);
  run_command->run = [run_command, ran] { return run(*run_command, *ran); };

  Command* evaluate_command = add_command(
      keypoints, "evaluate",
      "Errors of the keypoint network on crops with truth, or on the true boxes of scenes whose "
      "truth has keypoints: PCK at 2 px of 64 and at 0.1 of the box's larger side, average "
      "precision (APK), by keypoint, box height and heading, and whether its sigmas hold.",
      "  camber keypoints evaluate validation\n"
      "  camber keypoints evaluate scenes/* --least-height 40 --plot keypoints.png --json");
  App& app = *evaluate_command->app;
  app.add_option("inputs", judged->inputs, "folders of crops, or scene manifests or folders")
      ->required();
  app.add_option("--least-height", judged->truth.least_height, "of true boxes of scenes, px")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--most-occlusion", judged->truth.most_occlusion, "of vehicles of scenes, a share")
      ->check(in_range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--most-truncation", judged->truth.most_truncation, "likewise")
      ->check(in_range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--out", judged->out, "file for the result (.json)")->output_file();
  app.add_option("--plot", judged->plot, "file for a plot (.png)")->output_file();
  add_arguments(app, *judged);
  evaluate_command->run = [evaluate_command, judged] {
    return evaluate(*evaluate_command, *judged);
  };
}

}  // namespace camber::tools
