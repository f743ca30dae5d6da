#include "camber/pipeline/stages/load.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string_view>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/threads.h"
#include "camber/image/image_io.h"
#include "camber/image/video.h"
#include "camber/scene/marking_presets.h"
#include "camber/scene/travelled.h"
#include "camber/scene/validate_scene.h"

namespace camber {

bool KnownMetres::has_speed() const {
  return std::any_of(travelled.begin(), travelled.end(),
                     [](const auto& stretch) { return stretch.has_value(); });
}

bool LoadedFrames::has_poses() const {
  return contradicted_poses.empty() &&
         std::all_of(frames.begin(), frames.end(),
                     [](const SceneFrame& frame) { return frame.world_from_camera.has_value(); });
}

}  // namespace camber

namespace camber::stages {
namespace {

std::vector<int> label_values(const Scene& scene, const std::string& name) {
  const auto found = scene.segmentation_classes.find(name);
  return found == scene.segmentation_classes.end() ? std::vector<int>() : found->second;
}

/// The labels of a frame: those that the options give, else those in memory, else the file's.
FrameMasks read_masks(const Scene& scene, const SceneFrame& frame, const FramePixels& pixels,
                      const Undistortion& lens, const LoadOptions& options) {
  const auto given = options.labels.find(frame.id);
  MaskInputs inputs;
  inputs.classes = {label_values(scene, "road"), label_values(scene, "pavement"),
                    label_values(scene, "vehicle")};
  if (const auto boxes = options.vehicle_boxes.find(frame.id);
      boxes != options.vehicle_boxes.end()) {
    inputs.vehicle_boxes = boxes->second;
  }
  for (const VehicleDetection& v : frame.vehicles) inputs.vehicle_boxes.push_back(v.box);
  inputs.hidden = lens.outside();
  if (!options.use_masks) return make_frame_masks(scene.camera, inputs);
  if (!inputs.classes.road.empty() || !inputs.classes.pavement.empty()) {
    if (given != options.labels.end()) {
      inputs.segmentation = lens.labels(given->second);
    } else if (!pixels.segmentation.empty()) {
      inputs.segmentation = make_frame_labels(pixels.segmentation, lens, frame.id, "segmentation");
    } else if (!frame.segmentation.empty()) {
      inputs.segmentation = lens.labels(read_label_image(frame.segmentation, lens.raw()));
    }
  }
  if (inputs.segmentation) return make_frame_masks(scene.camera, inputs);
  if (!pixels.road_mask.empty()) {
    inputs.road_mask = make_frame_labels(pixels.road_mask, lens, frame.id, "road mask");
  } else if (!frame.road_mask.empty()) {
    inputs.road_mask = lens.labels(read_label_image(frame.road_mask, lens.raw()));
  }
  return make_frame_masks(scene.camera, inputs);
}

/// What is in memory of the frames, one entry a frame.
std::vector<FramePixels> pixels_of(const std::vector<SceneFrame>& frames,
                                   const LoadOptions& options) {
  std::vector<FramePixels> out(frames.size());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (options.pixels) out[k] = options.pixels(frames[k].id);
    if (out[k].image.empty() && frames[k].image.empty()) {
      throw NoAnswerError("frame " + std::to_string(frames[k].id) +
                          " has no image in the manifest; reconstruction needs images");
    }
  }
  return out;
}

/// The images of the frames: those in memory (moved out of `pixels`) and, in one go, the files'.
std::vector<FrameImage> images_of(const std::vector<SceneFrame>& frames, const Undistortion& lens,
                                  const LoadOptions& options, std::vector<FramePixels>* pixels) {
  std::vector<FrameImage> out(frames.size());
  std::vector<std::filesystem::path> paths;
  std::vector<std::size_t> from_file, from_memory;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const bool held = !(*pixels)[k].image.empty();
    (held ? from_memory : from_file).push_back(k);
    if (!held) paths.push_back(frames[k].image);
  }
  std::vector<FrameImage> read = read_frame_images(paths, lens, options.num_threads);
  for (std::size_t i = 0; i < read.size(); ++i) out[from_file[i]] = std::move(read[i]);
  parallel_for(from_memory.size(), options.num_threads, [&](std::size_t i) {
    const std::size_t k = from_memory[i];
    out[k] = make_frame_image(std::move((*pixels)[k].image), lens, frames[k].id);
  });
  return out;
}

using InputHashes = std::vector<std::pair<std::string, std::string>>;

/// Hashes of what is read of each frame: files, a video with the first of its frames, and memory.
/// @param videos  those that are hashed already; grows.
std::vector<InputHashes> hashes_of(const std::vector<SceneFrame>& frames,
                                   const std::vector<FramePixels>& pixels,
                                   const LoadOptions& options,
                                   std::set<std::filesystem::path>* videos) {
  std::vector<std::filesystem::path> image_files(frames.size());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (!pixels[k].image.empty()) continue;
    const auto video = video_frame_name(frames[k].image);
    if (!video || videos->insert(video->file).second) {
      image_files[k] = image_file_of(frames[k].image);
    }
  }
  std::vector<InputHashes> out(frames.size());
  parallel_for(frames.size(), options.num_threads, [&](std::size_t k) {
    const SceneFrame& frame = frames[k];
    const auto hash = [&](const Image& held, const char* name, const std::filesystem::path& path) {
      if (!held.empty()) {
        const std::string_view bytes(reinterpret_cast<const char*>(held.data.data()),
                                     held.data.size());
        out[k].emplace_back("frame " + std::to_string(frame.id) + ": " + name, hash_bytes(bytes));
      } else if (!path.empty()) {
        out[k].emplace_back(path.string(), hash_file(path));
      }
    };
    hash(pixels[k].image, "image", image_files[k]);
    if (!options.use_masks || options.labels.count(frame.id) > 0) return;
    hash(pixels[k].segmentation, "segmentation", frame.segmentation);
    hash(pixels[k].road_mask, "road mask", frame.road_mask);
  });
  return out;
}

KnownMetres known_metres(const Scene& scene, const std::vector<int>& frame_ids, double frame_rate) {
  KnownMetres out{scene.height_above_road, scene.height_sigma, marking_sizes(scene), {}, {}};
  SpeedWeights weights;
  for (std::size_t k = 1; k < frame_ids.size(); ++k) {
    out.travelled.push_back(
        travelled_between(scene, frame_ids[k - 1], frame_ids[k], frame_rate, &weights));
  }
  out.travelled_sigma = travelled_sigma(scene, frame_rate, weights);
  return out;
}

template <class T>
void cut(const FrameRange& range, std::vector<T>* entries) {
  entries->erase(entries->begin() + static_cast<std::ptrdiff_t>(range.last) + 1, entries->end());
  entries->erase(entries->begin(), entries->begin() + static_cast<std::ptrdiff_t>(range.first));
}

/// What a run knows of all its frames, none of them loaded.
LoadedFrames of_scene(const Scene& scene, const std::vector<int>& frame_ids) {
  LoadedFrames out;
  out.camera = scene.camera;
  out.camera_sigma = scene.camera_sigma;
  out.detections_source = scene.detections_source;
  out.masks_by_network = scene.segmentation_source.rfind("network:", 0) == 0;
  out.box_sigma_px = scene.box_sigma_px;
  out.frame_rate = scene.frame_rate.value_or(out.frame_rate);
  out.known = known_metres(scene, frame_ids, out.frame_rate);
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

void check_frame_count(std::size_t count) {
  if (count <= kMostFrames) return;
  throw std::invalid_argument(
      fmt::format("{} frames, expected at most {} at once: choose fewer, for example 0:100:10",
                  count, kMostFrames));
}

LoadedFrames load(const Scene& scene, const std::vector<int>& frame_ids,
                  const LoadOptions& options) {
  if (frame_ids.size() < (options.single_image ? 1U : 2U)) {
    throw NoAnswerError("one frame alone has no parallax: at least 2 frames are needed, " +
                        std::to_string(frame_ids.size()) + " given");
  }
  check_frame_count(frame_ids.size());
  validate(scene);
  LoadedFrames out = of_scene(scene, frame_ids);
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
  std::vector<FramePixels> pixels = pixels_of(out.frames, options);
  std::set<std::filesystem::path> videos;
  for (auto& list : hashes_of(out.frames, pixels, options, &videos)) {
    out.input_hashes.insert(out.input_hashes.end(), list.begin(), list.end());
  }
  const Undistortion lens(scene.camera, scene.distortion);
  std::vector<FrameImage> images;
  parallel_for(2, options.num_threads, [&](std::size_t task) {
    if (task == 0) {
      images = images_of(out.frames, lens, options, &pixels);
      return;
    }
    parallel_for(count, options.num_threads, [&](std::size_t k) {
      out.masks[k] = read_masks(scene, out.frames[k], pixels[k], lens, options);
    });
  });
  for (std::size_t k = 0; k < count; ++k) {
    out.gray[k] = std::move(images[k].gray);
    out.color[k] = std::move(images[k].color);
  }
  require_different_images(out);
  return out;
}

struct FrameLoader::Impl {
  Impl(const Scene& of_scene, LoadOptions load_options)
      : scene(of_scene),
        options(std::move(load_options)),
        lens(of_scene.camera, of_scene.distortion) {}

  const Scene& scene;
  LoadOptions options;
  Undistortion lens;
  FrameImageReader images;
  std::set<std::filesystem::path> videos;  // hashed
};

FrameLoader::FrameLoader(const Scene& scene, LoadOptions options) {
  validate(scene);
  impl_ = std::make_unique<Impl>(scene, std::move(options));
}
FrameLoader::~FrameLoader() = default;

std::shared_ptr<const LoadedFrame> FrameLoader::load(int frame_id) {
  const SceneFrame* frame = impl_->scene.find_frame(frame_id);
  if (!frame) throw std::invalid_argument("the scene has no frame " + std::to_string(frame_id));
  auto out = std::make_shared<LoadedFrame>();
  out->frame = *frame;
  std::vector<FramePixels> pixels = pixels_of({*frame}, impl_->options);
  out->input_hashes = hashes_of({*frame}, pixels, impl_->options, &impl_->videos).front();
  out->masks = read_masks(impl_->scene, *frame, pixels.front(), impl_->lens, impl_->options);
  FrameImage image = pixels.front().image.empty()
                         ? impl_->images.read(frame->image, impl_->lens)
                         : make_frame_image(std::move(pixels.front().image), impl_->lens, frame_id);
  out->gray = std::move(image.gray);
  out->color = std::move(image.color);
  return out;
}

LoadedFrames frame_window(const Scene& scene,
                          const std::vector<std::shared_ptr<const LoadedFrame>>& frames,
                          std::size_t reference) {
  if (reference >= frames.size()) {
    throw std::invalid_argument(
        fmt::format("reference {} of a window of {} frames", reference, frames.size()));
  }
  std::vector<int> ids;
  for (const auto& frame : frames) ids.push_back(frame->frame.id);
  LoadedFrames out = of_scene(scene, ids);
  out.reference = reference;
  for (const auto& frame : frames) {
    out.frames.push_back(frame->frame);
    out.gray.push_back(frame->gray);
    out.color.push_back(frame->color);
    out.masks.push_back(frame->masks);
    out.input_hashes.insert(out.input_hashes.end(), frame->input_hashes.begin(),
                            frame->input_hashes.end());
  }
  require_different_images(out);
  return out;
}

LoadedFrames frames_within(const FrameRange& range, const Scene& scene, LoadedFrames frames) {
  if (range.first > frames.reference || range.last < frames.reference ||
      range.last >= frames.size()) {
    throw std::invalid_argument(fmt::format("frames {} to {} of {} without the reference, {}",
                                            range.first, range.last, frames.size(),
                                            frames.reference));
  }
  cut(range, &frames.frames);
  cut(range, &frames.gray);
  cut(range, &frames.color);
  cut(range, &frames.masks);
  frames.reference -= range.first;
  std::vector<int> ids;
  for (const SceneFrame& frame : frames.frames) ids.push_back(frame.id);
  frames.known = known_metres(scene, ids, frames.frame_rate);
  return frames;
}

}  // namespace camber::stages
