#include "camber/pipeline/reconstruct_scene.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "camber/calibrate/guessed_camera.h"
#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/core/stopwatch.h"
#include "camber/pipeline/find_vehicles.h"

namespace camber {
namespace {

/// The same source, asked once for each frame.
FramePixelSource remembered(const FramePixelSource& source) {
  if (!source) return {};
  const auto held = std::make_shared<std::map<int, FramePixels>>();
  return [source, held](int id) {
    const auto found = held->find(id);
    if (found != held->end()) return found->second;
    return held->emplace(id, source(id)).first->second;
  };
}

/// One run of some frames, with what networks find in them.
class Attempt {
 public:
  Attempt(const Scene& scene, const std::vector<int>& frames,
          const ReconstructSceneOptions& options, const Progress& progress)
      : scene_(scene), frames_(frames), options_(options), run_(options.run), progress_(progress) {
    stages::check_frame_count(frames.size());
    run_.load.pixels = remembered(options.run.load.pixels);
  }

  SceneReconstruction run() {
    look();
    Reconstruction result = reconstruct(scene_, frames_, run_, progress_);
    if (any_network() || masking_) {
      result.run.extra["networks"] = network_json(view_, keypoints_, masking_);
      for (const auto& [stage, ms] : time_.stages()) result.run.timings.add(stage, ms);
    }
    report();
    return {std::move(result), std::move(scene_), std::nullopt};
  }

 private:
  bool any_network() const { return view_.detector || view_.segmenter || keypoints_; }

  void look() {
    DetectFramesOptions networks = detect_options(options_.networks, run_.num_threads);
    FindKeypointsOptions keypoints = keypoint_options(options_.networks, run_.num_threads);
    networks.pixels = keypoints.pixels = run_.load.pixels;
    by_shipped_ = options_.places_vehicles && options_.networks.detector.empty() &&
                  !has_boxes(scene_) && has_images(scene_, frames_, networks.pixels);
    if (by_shipped_) networks.networks.detector = kShippedNetwork;
    if (!networks.networks.empty()) {
      const StageTimer timer(time_, "networks");
      view_ = detect_frames(scene_, frames_, networks, progress_, options_.warn);
      put_network_view(view_, &scene_);
    } else if (options_.networks.may_mask()) {
      const StageTimer timer(time_, "networks");
      masking_ = mask_vehicles(scene_, frames_, networks, &run_.load, progress_);
    }
    {
      const StageTimer timer(time_, "keypoints");
      keypoints_ = find_keypoints(&scene_, frames_, keypoints, progress_, options_.warn);
    }
    run_.load.labels = view_.labels;
  }

  void report() const {
    if (!options_.notice) return;
    if (by_shipped_) {
      options_.notice(
          "the scene has no boxes: vehicles are what the shipped detector finds (--detector none "
          "leaves them out)");
    }
    if (any_network()) {
      std::string text = describe(view_, keypoints_);
      if (!text.empty()) text.pop_back();  // the last line's end
      options_.notice("networks:\n" + text);
    }
    if (masking_) {
      options_.notice(
          "no mask and no box shows vehicles: what the shipped detector takes for them is left out "
          "of the road");
    }
  }

  Scene scene_;
  const std::vector<int>& frames_;
  const ReconstructSceneOptions& options_;
  ReconstructOptions run_;
  const Progress& progress_;
  bool by_shipped_ = false;
  NetworkView view_;
  std::optional<NetworkUse> masking_, keypoints_;
  Timings time_;
};

/// As many frames of a scene about one of them, some ten a second: more show the same.
std::vector<int> frames_about(const Scene& scene, int reference, std::size_t most) {
  constexpr double kRate = 10.0;  // Hz
  const auto apart =
      static_cast<std::size_t>(std::max(1L, std::lround(scene.frame_rate.value_or(kRate) / kRate)));
  const auto found = std::find_if(scene.frames.begin(), scene.frames.end(),
                                  [&](const SceneFrame& frame) { return frame.id == reference; });
  const auto at = static_cast<std::size_t>(found - scene.frames.begin());
  std::vector<int> all;
  for (std::size_t i = at % apart; i < scene.frames.size(); i += apart) {
    all.push_back(scene.frames[i].id);
  }
  if (all.size() <= most) return all;
  const std::size_t middle = at / apart;
  const std::size_t first = std::min(middle - std::min(middle, most / 2), all.size() - most);
  const auto begin = all.begin() + static_cast<std::ptrdiff_t>(first);
  return {begin, begin + static_cast<std::ptrdiff_t>(most)};
}

CameraByDrive calibrate(const Scene& scene, const ReconstructSceneOptions& options,
                        const Progress& progress) {
  const std::vector<int> chosen =
      options.frames.empty() ? select_frames(scene, "") : options.frames;
  CalibrateOptions calibration;
  calibration.seed = options.run.seed;
  calibration.num_threads = options.run.num_threads;
  calibration.find_vehicles =
      vehicle_finder(options.networks, options.run.num_threads, options.run.load.pixels);
  return calibrate_guessed(
      scene, frames_about(scene, choose_reference_frame(scene, chosen), kMostCalibrationFrames),
      calibration, options.run.load.pixels, progress);
}

/// Positions on the map are no source of metres of a few frames: the height by them is, where the
/// scene has none.
void put_height_by_positions(CameraByDrive* camera, const ReconstructSceneOptions& options) {
  if (!camera->scene || camera->scene->height_above_road) return;
  const auto height = height_by(*camera->calibration, "positions");
  if (!height) return;
  camera->scene->height_above_road = height->value;
  camera->scene->height_sigma = height->sigma;
  if (!options.notice) return;
  options.notice(fmt::format("the camera is {:.2f} +- {:.2f} m above the road by its positions",
                             height->value, height->sigma));
}

/// The frames that are asked for, or chosen, and fewer where they give no answer.
SceneReconstruction run_chosen(const Scene& scene, const ReconstructSceneOptions& options,
                               const Progress& progress) {
  const auto with = [&](const std::vector<int>& frames) {
    return Attempt(scene, frames, options, progress).run();
  };
  const auto notice = [&](const std::string& what) {
    if (options.notice) options.notice(what);
  };
  if (!options.frames.empty()) return with(options.frames);
  if (scene.frames.size() == 1) return with({scene.frames.front().id});
  const ChosenFrames chosen =
      choose_frames(scene, options.run.load.pixels, options.run.preset == Preset::kPaper ? 1 : 2);
  if (chosen.spacing > 1) {
    notice(fmt::format("slow drive: frames {} away from the reference are used", chosen.spacing));
  }
  constexpr std::size_t kManyFrames = 20;
  if (scene.frames.size() >= kManyFrames) {
    notice(fmt::format("{} of {} frames are used; camber drive uses all of them", chosen.ids.size(),
                       scene.frames.size()));
  }
  std::vector<int> ids = chosen.ids;
  for (const std::vector<int>& instead : chosen.instead) {
    try {
      return with(ids);
    } catch (const NoAnswerError& error) {
      notice(fmt::format("frames {} give no answer ({}): {} are used", fmt::join(ids, ","),
                         error.what(), fmt::join(instead, ",")));
      ids = instead;
    }
  }
  return with(ids);
}

}  // namespace

SceneReconstruction reconstruct_scene(const Scene& scene, const ReconstructSceneOptions& options,
                                      const Progress& progress) {
  keep_freed_memory();
  std::optional<CameraByDrive> camera;
  if (options.calibrates && camera_is_guessed(scene)) {
    camera = calibrate(scene, options, progress);
    if (options.notice) options.notice(camera->text);
    put_height_by_positions(&*camera, options);
  }
  SceneReconstruction out =
      run_chosen(camera && camera->scene ? *camera->scene : scene, options, progress);
  out.result.run.options["calibrate"] = options.calibrates;
  if (camera) {
    out.result.run.extra["camera_by_drive"] = to_json(*camera);
    out.result.run.timings.add("calibrate", camera->milliseconds);
    out.calibrated = std::move(camera->scene);
  }
  return out;
}

}  // namespace camber
