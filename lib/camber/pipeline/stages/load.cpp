#include "camber/pipeline/stages/load.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/threads.h"
#include "camber/image/image_io.h"
#include "camber/image/video.h"

namespace camber {

bool KnownMetres::has_speed() const {
  return std::any_of(travelled.begin(), travelled.end(),
                     [](const auto& stretch) { return stretch.has_value(); });
}

}  // namespace camber

namespace camber::stages {
namespace {

std::vector<int> label_values(const Scene& scene, const std::string& name) {
  const auto found = scene.segmentation_classes.find(name);
  return found == scene.segmentation_classes.end() ? std::vector<int>() : found->second;
}

FrameMasks read_masks(const Scene& scene, const SceneFrame& frame, const Undistortion& lens,
                      const LoadOptions& options) {
  const bool use_masks = options.use_masks;
  const auto given = options.labels.find(frame.id);
  MaskInputs inputs;
  inputs.classes = {label_values(scene, "road"), label_values(scene, "pavement"),
                    label_values(scene, "vehicle")};
  for (const VehicleDetection& v : frame.vehicles) inputs.vehicle_boxes.push_back(v.box);
  const bool shows_ground = !inputs.classes.road.empty() || !inputs.classes.pavement.empty();
  if (use_masks && given != options.labels.end() && shows_ground) {
    inputs.segmentation = lens.labels(given->second);
  } else if (use_masks && !frame.segmentation.empty() && shows_ground) {
    inputs.segmentation = lens.labels(read_label_image(frame.segmentation, lens.raw()));
  } else if (use_masks && !frame.road_mask.empty()) {
    inputs.road_mask = lens.labels(read_label_image(frame.road_mask, lens.raw()));
  }
  inputs.hidden = lens.outside();
  return make_frame_masks(scene.camera, inputs);
}

LaneMarkingSizes marking_sizes(const Scene& scene) {
  const auto size = [&](const char* name) {
    const auto found = scene.markings_m.find(name);
    return found == scene.markings_m.end() ? 0.0 : found->second;
  };
  return {size("dash_length"), size("dash_gap"), size("line_width"), size("zebra_stripe_width"),
          size("zebra_gap")};
}

double time_of(const SceneFrame& frame, double frame_rate) {
  return frame.time_s.value_or(frame.id / frame_rate);
}

/// The distance between two frames: the integral of the speeds of all frames from one to the other,
/// linear between them. Their errors are taken to be one and the same.
std::optional<TravelledDistance> travelled_between(const Scene& scene, int from, int to,
                                                   double frame_rate) {
  const SceneFrame* before = nullptr;
  TravelledDistance out;
  for (const SceneFrame& frame : scene.frames) {
    if (frame.id < from || frame.id > to || !frame.speed) continue;
    if (!before && frame.id != from) return std::nullopt;
    if (before) {
      const double span = time_of(frame, frame_rate) - time_of(*before, frame_rate);
      if (!(span > 0.0)) return std::nullopt;
      out.metres += 0.5 * span * (*before->speed + *frame.speed);
      out.sigma += 0.5 * span * (before->speed_sigma + frame.speed_sigma);
    }
    before = &frame;
  }
  if (!before || before->id != to || !(out.sigma > 0.0)) return std::nullopt;
  return out;
}

void require_different_images(const LoadedFrames& frames) {
  for (std::size_t a = 0; a < frames.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      if (frames.gray[a].pixels == frames.gray[b].pixels) {
        throw NoAnswerError("frames " + std::to_string(frames.frames[b].id) + " and " +
                            std::to_string(frames.frames[a].id) +
                            " have the same image: no parallax between them");
      }
    }
  }
}

}  // namespace

LoadedFrames load(const Scene& scene, const std::vector<int>& frame_ids,
                  const LoadOptions& options) {
  if (frame_ids.size() < (options.single_image ? 1U : 2U)) {
    throw NoAnswerError("one frame alone has no parallax: at least 2 frames are needed, " +
                        std::to_string(frame_ids.size()) + " given");
  }
  LoadedFrames out;
  out.camera = scene.camera;
  out.known = {scene.height_above_road, scene.height_sigma, marking_sizes(scene), {}};
  out.detections_source = scene.detections_source;
  out.masks_by_network = scene.segmentation_source.rfind("network:", 0) == 0;
  out.box_sigma_px = scene.box_sigma_px;
  out.frame_rate = scene.frame_rate.value_or(out.frame_rate);
  for (std::size_t k = 1; k < frame_ids.size(); ++k) {
    out.known.travelled.push_back(
        travelled_between(scene, frame_ids[k - 1], frame_ids[k], out.frame_rate));
  }
  const int reference = choose_reference_frame(scene, frame_ids);
  for (const int id : frame_ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (!frame) throw std::invalid_argument("the scene has no frame " + std::to_string(id));
    if (id == reference) out.reference = out.frames.size();
    out.frames.push_back(*frame);
  }
  const std::size_t count = out.size();
  out.gray.resize(count);
  out.color.resize(count);
  out.masks.resize(count);
  std::vector<std::filesystem::path> paths;
  std::vector<std::set<std::filesystem::path>> read(
      count);  // files, of a video with its first frame
  std::set<std::filesystem::path> videos;
  for (std::size_t k = 0; k < count; ++k) {
    const SceneFrame& frame = out.frames[k];
    if (frame.image.empty()) {
      throw NoAnswerError("frame " + std::to_string(frame.id) +
                          " has no image in the manifest; reconstruction needs images");
    }
    paths.push_back(frame.image);
    const auto video = video_frame_name(frame.image);
    if (!video || videos.insert(video->file).second) read[k].insert(image_file_of(frame.image));
  }
  const Undistortion lens(scene.camera, scene.distortion);
  std::vector<FrameImage> images = read_frame_images(paths, lens, options.num_threads);
  std::vector<std::vector<std::pair<std::string, std::string>>> hashes(count);
  parallel_for(count, options.num_threads, [&](std::size_t k) {
    const SceneFrame& frame = out.frames[k];
    out.gray[k] = std::move(images[k].gray);
    out.color[k] = std::move(images[k].color);
    out.masks[k] = read_masks(scene, frame, lens, options);
    const auto hash = [&](const std::filesystem::path& path) {
      if (!path.empty()) hashes[k].emplace_back(path.string(), hash_file(path));
    };
    for (const auto& path : read[k]) hash(path);
    if (!options.use_masks || options.labels.count(frame.id) > 0) return;
    hash(frame.segmentation);
    hash(frame.road_mask);
  });
  for (auto& list : hashes) {
    out.input_hashes.insert(out.input_hashes.end(), list.begin(), list.end());
  }
  require_different_images(out);
  return out;
}

}  // namespace camber::stages
