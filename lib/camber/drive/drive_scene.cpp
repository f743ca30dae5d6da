#include "camber/drive/drive_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "camber/calibrate/guessed_camera.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/drive/detect_drive.h"
#include "camber/drive/drive_pictures.h"
#include "camber/drive/position_scale.h"
#include "camber/drive/window_log.h"
#include "camber/drive/write_drive.h"
#include "camber/image/video.h"
#include "camber/pipeline/find_vehicles.h"
#include "camber/render/film.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;
using Options = DriveSceneOptions;

/// What has to be equal for a part of a drive to be gone on with.
json header_of(const std::vector<int>& ids, const Options& o) {
  const NetworkChoice& networks = o.networks;
  return {{"version", kVersion},
          {"scene", o.manifest_hash},
          {"frames", ids},
          {"no_masks", !o.drive.window.load.use_masks},
          {"no_calibrate", !o.calibrates},
          {"networks",
           {networks.detector, networks.detector_config, networks.keypoints,
            networks.keypoints_config, networks.segmenter, networks.segmenter_config}},
          {"seed", o.drive.window.seed}};
}

json run_json(const Scene& scene, const Options& o, bool complete) {
  return {{"version", kVersion},
          {"seed", o.drive.window.seed},
          {"complete", complete},
          {"command", o.command},
          {"scene", o.manifest.string()},
          {"options",
           {{"frames", o.frames.empty() ? "all" : o.frames},
            {"use_masks", o.drive.window.load.use_masks},
            {"calibrate", o.calibrates}}},
          {"frames_given", scene.frames.size()}};
}

/// What an earlier drive left; nothing else is touched.
void remove_earlier(const fs::path& folder) {
  std::error_code none;
  for (const char* name :
       {"drive.json", "trajectory.tum", "trajectory.gpx", "poses.txt", "vehicles.json",
        "tracks.json", "tracks.csv", "strip", "surface", "plots", "segmentation", "report.html",
        "film.mp4", "film.pieces", "windows.log"}) {
    fs::remove_all(folder / name, none);
  }
}

/// Film, plots and report.
void write_pictures(const Scene& scene, const DriveResult& result, const DriveSurface& road,
                    const fs::path& folder, const Options& o, json* document,
                    const Progress& progress) {
  const DriveContent content = drive_content(scene, result, road);
  DriveFilmOptions film;
  film.film = o.film.empty() ? folder / "film.mp4" : o.film;
  film.pieces = folder / "film.pieces";
  Timings timings;
  StageTimer render(timings, "render");
  std::map<int, std::string> pictures = write_drive_film(scene, content, film, progress);
  render.stop();
  for (const auto& [stage, ms] : timings.stages()) (*document)["timings_ms"][stage] = ms;
  write_drive_report(content, *document, std::move(pictures), o.film.empty() ? "film.mp4" : "",
                     folder);
}

/// A camera that is guessed by the whole drive. @return nothing where it is known.
std::optional<CameraByDrive> camera_of(const Scene& scene, const std::vector<int>& ids,
                                       const Options& o, const Progress& progress) {
  if (!o.calibrates || !camera_is_guessed(scene)) return std::nullopt;
  CalibrateOptions options;
  options.seed = o.drive.window.seed;
  options.num_threads = o.drive.window.num_threads;
  options.find_vehicles =
      vehicle_finder(o.networks, o.drive.window.num_threads, o.drive.window.load.pixels);
  CameraByDrive out = calibrate_guessed(scene, ids, options, o.drive.window.load.pixels, progress);
  if (o.notice) o.notice(out.text);
  return out;
}

/// Where the scene of a result is kept that is not the one given.
fs::path kept_manifest(const fs::path& folder) { return folder / "scene" / "scene.json"; }

void add_files(const fs::path& folder, const Options& o, const Scene* calibrated) {
  if (o.add_files) {
    o.add_files(folder, calibrated);
  } else if (calibrated) {
    fs::create_directories(kept_manifest(folder).parent_path());
    write_scene(*calibrated, kept_manifest(folder));
  }
}

/// What networks find in the frames of a drive, before its windows are measured.
class Detection {
 public:
  explicit Detection(const Options& o)
      : options_(o),
        networks_(detect_options(o.networks, o.drive.window.num_threads)),
        keypoints_(keypoint_options(o.networks, o.drive.window.num_threads)) {
    networks_.pixels = keypoints_.pixels = o.drive.window.load.pixels;
  }

  /// @param labels  folder of what a segmenter finds.
  void run(const std::vector<int>& ids, const fs::path& labels, const Progress& progress,
           Scene* scene) {
    const bool by_shipped = options_.networks.detector.empty() && !has_boxes(*scene) &&
                            has_images(*scene, ids, networks_.pixels);
    if (by_shipped) networks_.networks.detector = kShippedNetwork;
    const StageTimer timer(time_, "networks");
    seen_ = detect_drive(scene, ids, networks_, keypoints_, labels, progress, options_.warn);
    if (by_shipped && options_.notice) {
      options_.notice(
          "the scene has no boxes: vehicles are what the shipped detector finds (--detector none "
          "leaves them out)");
    }
  }

  void report(json* document, Timings* timings) const {
    if (networks_.networks.empty() && !seen_.keypoints) return;
    (*document)["networks"] = network_json(seen_.view, seen_.keypoints);
    for (const auto& [stage, ms] : time_.stages()) timings->add(stage, ms);
  }

 private:
  const Options& options_;
  DetectFramesOptions networks_;
  FindKeypointsOptions keypoints_;
  DriveNetworks seen_;
  Timings time_;
};

void check_film(const Options& o) {
  if (o.film.empty()) return;
  if (!o.pictures) throw UsageError("--film: found --no-pictures beside it");
  if (!FilmWriter::knows(o.film.extension().string())) {
    throw UsageError("--film: found '" + o.film.string() + "', expected FILE.mp4 or FILE.avi");
  }
  check_output_file(o.film);
}

/// Before anything that is there goes. @throws NoAnswerError, InputError.
void check_frames(const Scene& scene, const std::vector<int>& ids, const FramePixelSource& pixels) {
  if (ids.size() < 2) {
    throw NoAnswerError(fmt::format("a drive of {} frame: at least 2 are needed", ids.size()));
  }
  if (pixels) return;
  std::error_code none;
  for (const int id : ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (frame && !frame->image.empty() && fs::exists(image_file_of(frame->image), none)) return;
  }
  throw InputError(scene.find_frame(ids.front())->image.string(),
                   "no such file, nor is one of the other frames' images there");
}

/// The run.json of a complete result of the same inputs; null where there is none.
/// @throws UsageError where `resume` finds one of other inputs.
json complete_run(const fs::path& folder, const Options& o, const json& header) {
  const fs::path file = folder / "run.json";
  std::error_code none;
  if (!o.resume || fs::exists(folder / "windows.log", none) || !fs::exists(file, none)) {
    return nullptr;
  }
  json run = parse_json(read_whole_file(file), file.string());
  if (!run.is_object() || !run.value("complete", false) || !run.contains("inputs")) return nullptr;
  require_equal_header(folder, run.at("inputs"), header);
  const bool pictures = fs::exists(folder / "report.html", none);
  return !o.pictures || pictures ? run : json(nullptr);
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
  const std::size_t rejected = result.tracks.num_rejected();
  if (rejected > 0) {
    const auto first =
        std::find_if(result.tracks.tracks.begin(), result.tracks.tracks.end(),
                     [](const DriveTrack& track) { return !track.rejected.empty(); });
    out.push_back(
        {{"code", "tracks_rejected"},
         {"text", fmt::format("{} of {} tracks are no vehicles by their size, height above "
                              "the road or motion, and are left out (tracks.json): track "
                              "{}, {}{}",
                              rejected, result.tracks.tracks.size(), first->id, first->rejected,
                              rejected > 1 ? ", ..." : "")}});
  }
  const std::optional<DrivePositions>& positions = result.document.positions;
  if (positions && positions->disagreement_sigmas > kMostPositionSigmas) {
    out.push_back(
        {{"code", "positions_contradicted"},
         {"text", fmt::format("by its positions on the map the drive is {:.1f} % {}, {:.1f} "
                              "standard deviations: its length is known no better",
                              100.0 * std::abs(std::expm1(positions->log_scale)),
                              positions->log_scale > 0.0 ? "longer" : "shorter",
                              positions->disagreement_sigmas)}});
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
          {"tracks", result.tracks.tracks.size() - result.tracks.num_rejected()},
          {"rejected_tracks", result.tracks.num_rejected()}};
}

}  // namespace

DriveOutcome drive_scene(const Scene& given, const fs::path& folder, const Options& asked,
                         const Progress& progress) {
  check_film(asked);
  Options o = asked;
  Scene scene = given;
  Detection detection(o);
  const std::vector<int> ids = select_frames(scene, o.frames);
  const json header = header_of(ids, o);
  if (json there = complete_run(folder, o, header); !there.is_null()) {
    return {std::move(there), true};
  }
  const bool goes_on = o.resume && fs::exists(folder / "windows.log");
  if (!goes_on) check_output_folder(folder, o.overwrite, o.inputs);
  check_frames(scene, ids, o.drive.window.load.pixels);
  keep_freed_memory();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  if (!goes_on) remove_earlier(folder);
  write_json(run_json(scene, o, false), folder / "run.json");
  const std::optional<CameraByDrive> camera = camera_of(scene, ids, o, progress);
  const Scene* const calibrated = camera && camera->scene ? &*camera->scene : nullptr;
  if (calibrated) {
    scene = *calibrated;
    o.manifest = fs::absolute(kept_manifest(folder)).lexically_normal();
  }
  detection.run(ids, folder / "segmentation", progress, &scene);
  DriveResult result;
  {
    WindowLog log(folder / "windows.log", header, goes_on);
    result = run_drive(scene, ids, o.drive, &log, progress);
  }
  json document = run_json(scene, o, true);
  document["resumed"] = goes_on;
  document["inputs"] = header;
  detection.report(&document, &result.timings);
  if (camera) {
    document["camera_by_drive"] = to_json(*camera);
    result.timings.add("calibrate", camera->milliseconds);
  }
  for (const auto& [stage, ms] : result.timings.stages()) document["timings_ms"][stage] = ms;
  document["metric"] = result.trajectory.metric;
  document["windows"] = window_scales(result.trajectory);
  document["drive"] = summary_of(result);
  const DriveSurface road = drive_surface(scene, result, o.manifest, o.drive.window.seed);
  document["warnings"] = warnings_of(result, road);
  write_drive(result, road, o.drive.strip, folder);
  if (o.gpx) o.gpx(result, road, folder / "trajectory.gpx");
  if (o.pictures) write_pictures(scene, result, road, folder, o, &document, progress);
  add_files(folder, o, calibrated);
  write_json(document, folder / "run.json");
  fs::remove_all(folder / "film.pieces", error);
  fs::remove(folder / "windows.log", error);
  return {std::move(document), false};
}

}  // namespace camber
