#include "drive_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/memory.h"
#include "camber/core/protected_inputs.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/drive/detect_drive.h"
#include "camber/drive/drive_pictures.h"
#include "camber/drive/write_drive.h"
#include "camber/export/trajectory.h"
#include "camber/image/video.h"
#include "camber/render/film.h"
#include "camber/scene/georeference.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"
#include "drive_progress.h"
#include "own_inputs.h"
#include "result_map.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

using nlohmann::json;

/// What has to be equal for a part of a drive to be gone on with.
json header_of(const OpenedScene& opened, const std::vector<int>& ids, const Command& command,
               const DriveArguments& a) {
  const fs::path& manifest = opened.manifest;
  return {{"version", kVersion},
          {"scene", hash_file(fs::is_directory(manifest) ? manifest / "scene.json" : manifest)},
          {"frames", ids},
          {"no_masks", a.no_masks},
          {"networks",
           {a.networks.detector, a.networks.detector_config, a.networks.keypoints,
            a.networks.keypoints_config}},
          {"seed", command.common.seed}};
}

json run_json(const Command& command, const DriveArguments& a, const SceneInput& input,
              bool complete) {
  return {
      {"version", kVersion},
      {"seed", command.common.seed},
      {"complete", complete},
      {"command", command.common.command_line},
      {"scene", input.manifest().string()},
      {"options", {{"frames", a.frames.empty() ? "all" : a.frames}, {"use_masks", !a.no_masks}}},
      {"frames_given", input.opened().scene.frames.size()}};
}

/// What an earlier drive left; nothing else is touched.
void remove_earlier(const fs::path& folder) {
  std::error_code none;
  for (const char* name : {"drive.json", "trajectory.tum", "trajectory.gpx", "poses.txt",
                           "vehicles.json", "tracks.json", "tracks.csv", "strip", "surface",
                           "plots", "report.html", "film.mp4", "film.pieces", "windows.log"}) {
    fs::remove_all(folder / name, none);
  }
}

/// The place on the map as a track of points on the earth, where the frames have positions.
void write_gpx(const DriveResult& result, const DriveSurface& road, const fs::path& file) {
  const std::optional<GeoReference> map = georeference_of(road.run, file);
  if (!map) return;
  std::vector<StampedPose> poses;
  for (const DriveFrame& frame : result.document.frames) {
    if (!frame.world_from_camera) continue;
    poses.push_back({frame.id, frame.time_s, map->map_from_reference * *frame.world_from_camera});
  }
  write_file_atomically(file, encode_gpx(track_on_earth(poses, map->crs, true)));
}

/// Film, plots and report.
void write_pictures(const Scene& scene, const DriveResult& result, const DriveSurface& road,
                    const DriveArguments& a, json* document, const Progress& progress) {
  const fs::path folder = a.out;
  const DriveContent content = drive_content(scene, result, road);
  DriveFilmOptions film;
  film.film = a.film.empty() ? folder / "film.mp4" : fs::path(a.film);
  film.pieces = folder / "film.pieces";
  Timings timings;
  StageTimer render(timings, "render");
  std::map<int, std::string> pictures = write_drive_film(scene, content, film, progress);
  render.stop();
  for (const auto& [stage, ms] : timings.stages()) (*document)["timings_ms"][stage] = ms;
  const std::string link = a.film.empty() ? "film.mp4" : std::string();
  write_drive_report(content, *document, std::move(pictures), link, folder);
}

/// What networks find in the frames of a drive, before its windows are measured.
class Detection {
 public:
  Detection(const Command& command, const DriveArguments& a)
      : networks_(detect_options(a.networks, command.common.threads)),
        keypoints_(keypoint_options(a.networks, command.common.threads)) {
    if (!a.networks.segmenter.empty()) {
      throw UsageError(
          "--segmenter: the labels of a whole drive are not computed on the way; camber detect "
          "--segmenter writes a scene with them");
    }
  }

  void add_files(std::vector<fs::path>* inputs) const {
    for (const fs::path& file : files_of(networks_.networks)) inputs->push_back(file);
    for (const fs::path& file : files_of(keypoints_)) inputs->push_back(file);
  }

  void run(const Command& command, const DriveArguments& a, const std::vector<int>& ids,
           const Progress& progress, Scene* scene) {
    const bool by_shipped =
        a.networks.detector.empty() && !has_boxes(*scene) && has_images(*scene, ids);
    if (by_shipped) networks_.networks.detector = kShippedNetwork;
    const StageTimer timer(time_, "networks");
    seen_ = detect_drive(scene, ids, networks_, keypoints_, progress,
                         make_warning_sink(command.common));
    if (by_shipped && !command.common.quiet) {
      fmt::print(stderr,
                 "camber: the scene has no boxes: vehicles are what the shipped detector finds "
                 "(--detector none leaves them out)\n");
    }
  }

  void report(json* document, Timings* timings) const {
    if (networks_.networks.empty() && !seen_.keypoints) return;
    (*document)["networks"] = network_json(seen_.view, seen_.keypoints);
    for (const auto& [stage, ms] : time_.stages()) timings->add(stage, ms);
  }

 private:
  DetectFramesOptions networks_;
  FindKeypointsOptions keypoints_;
  DriveNetworks seen_;
  Timings time_;
};

void check_film(const DriveArguments& a) {
  if (a.film.empty()) return;
  if (a.no_pictures) throw UsageError("--film: found --no-pictures beside it");
  if (!FilmWriter::knows(fs::path(a.film).extension().string())) {
    throw UsageError("--film: found '" + a.film + "', expected FILE.mp4 or FILE.avi");
  }
  check_output_file(a.film);
}

/// Before anything that is there goes. @throws NoAnswerError, InputError.
void check_frames(const Scene& scene, const std::vector<int>& ids) {
  if (ids.size() < 2) {
    throw NoAnswerError(fmt::format("a drive of {} frame: at least 2 are needed", ids.size()));
  }
  std::error_code none;
  for (const int id : ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (frame && !frame->image.empty() && fs::exists(image_file_of(frame->image), none)) return;
  }
  throw InputError(scene.find_frame(ids.front())->image.string(),
                   "no such file, nor is one of the other frames' images there");
}

/// The run.json of a complete result of the same inputs; null where there is none.
/// @throws UsageError where --resume finds one of other inputs.
json complete_run(const DriveArguments& a, const json& header) {
  const fs::path file = fs::path(a.out) / "run.json";
  std::error_code none;
  if (!a.resume || fs::exists(fs::path(a.out) / "windows.log", none) || !fs::exists(file, none)) {
    return nullptr;
  }
  const json run = parse_json(read_whole_file(file), file.string());
  if (!run.is_object() || !run.value("complete", false) || !run.contains("inputs")) return nullptr;
  require_equal_header(a.out, run.at("inputs"), header);
  const bool pictures = fs::exists(fs::path(a.out) / "report.html", none);
  return a.no_pictures || pictures ? run : json(nullptr);
}

json window_scales(const Trajectory& trajectory) {
  json out = json::array();
  for (const auto& w : trajectory.scales) {
    out.push_back(
        {{"reference", w.reference}, {"residual_sigma", w.residual_sigma}, {"weight", w.weight}});
  }
  return out;
}

json warnings_of(const DriveResult& result, const DriveSurface& road) {
  json out = json::array();
  const auto held = std::count_if(result.trajectory.poses.begin(), result.trajectory.poses.end(),
                                  [](const TrajectoryPose& pose) { return !pose.measured; });
  if (held > 0) {
    out.push_back({{"code", "poses_held"},
                   {"text", fmt::format("of {} frames no picture shows how the camera moved: they "
                                        "are bridged",
                                        held)}});
  }
  for (const RunDocument::Warning& warning : road.run.warnings) {
    out.push_back({{"code", warning.code}, {"text", warning.text}});
  }
  return out;
}

/// The figures of a drive, for whoever wants no more than those.
json summary_of(const DriveResult& result) {
  const auto weak = std::count_if(result.document.frames.begin(), result.document.frames.end(),
                                  [](const DriveFrame& f) { return f.status != Status::kOk; });
  const DriveDocument& drive = result.document;
  return {{"frames", drive.frames.size()},
          {"weak_frames", weak},
          {"length", number_json(drive.length)},
          {"length_sigma", number_json(drive.length_sigma)},
          {"camera_height", number_json(drive.height.value)},
          {"camera_height_sigma", number_json(drive.height.sigma)},
          {"cells", result.strip.cells.size()},
          {"tracks", result.tracks.tracks.size()}};
}

}  // namespace

DriveOutcome run_drive_job(const Command& command, const DriveArguments& a) {
  check_film(a);
  SceneInput input(command, a.input, a.out);
  Scene scene = input.opened().scene;
  std::vector<fs::path> inputs = files_of(scene);
  inputs.emplace_back(a.input.path);
  Detection detection(command, a);
  detection.add_files(&inputs);
  protect_inputs(inputs);
  const std::vector<int> ids = select_frames(scene, a.frames);
  const fs::path folder = a.out;
  const json header = header_of(input.opened(), ids, command, a);
  if (json there = complete_run(a, header); !there.is_null()) return {std::move(there), true};
  const bool goes_on = a.resume && fs::exists(folder / "windows.log");
  if (!goes_on) check_output_folder(folder, a.overwrite, inputs);
  check_frames(scene, ids);
  DriveOptions options;
  options.window.seed = command.common.seed;
  options.window.num_threads = command.common.threads;
  options.window.load.use_masks = !a.no_masks;
  keep_freed_memory();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  if (!goes_on) remove_earlier(folder);
  write_json(run_json(command, a, input, false), folder / "run.json");
  Progress progress = make_progress(command.common);
  detection.run(command, a, ids, progress, &scene);
  DriveResult result;
  {
    WindowLog log(folder / "windows.log", header, goes_on);
    progress = drive_progress(command.common, ids.size(), [&] { return log.frames().size(); });
    result = run_drive(scene, ids, options, &log, progress);
  }
  progress = drive_progress(command.common, ids.size(), {});
  json document = run_json(command, a, input, true);
  document["resumed"] = goes_on;
  document["inputs"] = header;
  detection.report(&document, &result.timings);
  for (const auto& [stage, ms] : result.timings.stages()) document["timings_ms"][stage] = ms;
  document["metric"] = result.trajectory.metric;
  document["windows"] = window_scales(result.trajectory);
  document["drive"] = summary_of(result);
  const DriveSurface road = drive_surface(scene, result, input.manifest(), command.common.seed);
  document["warnings"] = warnings_of(result, road);
  write_drive(result, road, options.strip, folder);
  write_gpx(result, road, folder / "trajectory.gpx");
  if (!a.no_pictures) write_pictures(scene, result, road, a, &document, progress);
  if (input.opened().kind != InputKind::kScene) {
    fs::remove_all(folder / "scene", error);  // an earlier run's
    input.keep_in(folder);
  }
  write_json(document, folder / "run.json");
  fs::remove_all(folder / "film.pieces", error);
  fs::remove(folder / "windows.log", error);
  return {std::move(document), false};
}

std::string describe_drive(const std::string& folder, const json& run) {
  const json& drive = run.at("drive");
  const double length = drive.at("length").is_number() ? drive.at("length").get<double>() : 0.0;
  const double sigma =
      drive.at("length_sigma").is_number() ? drive.at("length_sigma").get<double>() : 0.0;
  return fmt::format("{}: {} frames, {:.1f} {} +- {:.1f} %, {} cells of road, {} tracks", folder,
                     drive.at("frames").get<std::size_t>(), length,
                     run.value("metric", false) ? "m" : "units",
                     100.0 * sigma / std::max(length, 1e-9), drive.at("cells").get<std::size_t>(),
                     drive.at("tracks").get<std::size_t>());
}

}  // namespace camber::tools
