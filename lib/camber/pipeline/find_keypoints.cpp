#include "camber/pipeline/find_keypoints.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/image/undistortion.h"
#include "camber/image/video.h"
#include "camber/pipeline/network_file.h"
#include "camber/vehicle/shape_prior.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Images that are held at a time, at most; crops are small.
constexpr std::size_t kFramesAtOnce = 16;

bool wanted(const VehicleDetection& vehicle) {
  return shipped_vehicle_prior().has_shape(vehicle.vehicle_class) && vehicle.box.width() > 0.0 &&
         vehicle.box.height() > 0.0;
}

SceneFrame& frame_of(Scene* scene, int id) {
  for (SceneFrame& frame : scene->frames) {
    if (frame.id == id) return frame;
  }
  throw std::invalid_argument(fmt::format("the scene has no frame {}", id));
}

/// The frames that have a vehicle to look at; none where the choice excludes them.
std::vector<SceneFrame*> chosen_frames(Scene* scene, const std::vector<int>& frame_ids,
                                       const FindKeypointsOptions& options) {
  const KeypointChoice choice = options.choice;
  std::vector<SceneFrame*> out;
  if (choice == KeypointChoice::kNone) return out;
  for (const int id : frame_ids) {
    SceneFrame& frame = frame_of(scene, id);
    if (!std::any_of(frame.vehicles.begin(), frame.vehicles.end(), wanted)) continue;
    const bool given =
        std::any_of(frame.vehicles.begin(), frame.vehicles.end(),
                    [](const VehicleDetection& vehicle) { return !vehicle.keypoints.empty(); });
    const bool image = has_images(*scene, {id}, options.pixels);
    if (choice == KeypointChoice::kMissing && (given || !image)) return {};
    if (!image) {
      throw NoAnswerError(
          fmt::format("frame {} has no image in the manifest; keypoints need images", id));
    }
    out.push_back(&frame);
  }
  return out;
}

/// The images of some frames, undistorted, from memory or from their files.
std::vector<FrameImage> images_of(const std::vector<const SceneFrame*>& frames,
                                  const Undistortion& lens, const FindKeypointsOptions& options) {
  std::vector<FrameImage> out(frames.size());
  std::vector<fs::path> paths;
  std::vector<std::size_t> places;  // of these, in `frames`
  for (std::size_t i = 0; i < frames.size(); ++i) {
    FramePixels held = options.pixels ? options.pixels(frames[i]->id) : FramePixels();
    if (held.image.empty()) {
      paths.push_back(frames[i]->image);
      places.push_back(i);
    } else {
      out[i] = make_frame_image(std::move(held.image), lens, frames[i]->id);
    }
  }
  std::vector<FrameImage> read = read_frame_images(paths, lens, options.num_threads);
  for (std::size_t k = 0; k < read.size(); ++k) out[places[k]] = std::move(read[k]);
  return out;
}

}  // namespace

KeypointNetwork open_keypoint_network(const fs::path& network, const fs::path& config,
                                      const LogSink& warn) {
  if (network == kShippedNetwork && config.empty()) {
    OnnxFile file = shipped_keypoint_network();
    const KeypointsDescription description =
        parse_keypoints_description(shipped_keypoint_description(), file.name);
    return KeypointNetwork(std::move(file), description);
  }
  const KeypointsDescription description =
      read_keypoints_description(side_file_of(network, config), warn);
  return KeypointNetwork(read_onnx_file(network), description);
}

std::optional<NetworkUse> find_keypoints(Scene* scene, const std::vector<int>& frame_ids,
                                         const FindKeypointsOptions& options,
                                         const Progress& progress, const LogSink& warn) {
  const std::vector<SceneFrame*> frames = chosen_frames(scene, frame_ids, options);
  if (frames.empty()) return std::nullopt;
  const KeypointNetwork network = open_keypoint_network(options.network, options.config, warn);
  NetworkUse use;
  use.file = options.network.string();
  use.hash = network.network().hash();
  use.name = network.description().name;
  use.layers = network.network().layers();
  const Undistortion lens(scene->camera, scene->distortion);
  for (std::size_t first = 0; first < frames.size(); first += kFramesAtOnce) {
    if (progress) progress("keypoints", static_cast<double>(first) / frames.size());
    const std::size_t end = std::min(first + kFramesAtOnce, frames.size());
    const std::vector<FrameImage> images =
        images_of({frames.begin() + static_cast<std::ptrdiff_t>(first),
                   frames.begin() + static_cast<std::ptrdiff_t>(end)},
                  lens, options);
    std::vector<std::pair<VehicleDetection*, const Image*>> vehicles;
    for (std::size_t i = first; i < end; ++i) {
      for (VehicleDetection& vehicle : frames[i]->vehicles) {
        if (wanted(vehicle)) vehicles.emplace_back(&vehicle, &images[i - first].color);
      }
    }
    std::vector<KeypointCrop> places(vehicles.size());
    std::vector<Image> crops(vehicles.size());
    parallel_for(vehicles.size(), options.num_threads, [&](std::size_t i) {
      places[i] = keypoint_crop(vehicles[i].first->box);
      crops[i] =
          cut_crop(*vehicles[i].second, keypoint_crop(vehicles[i].first->box, network.crop_size()));
    });
    const std::vector<PredictedKeypoints> found = network.predict(crops, options.num_threads);
    for (std::size_t i = 0; i < vehicles.size(); ++i) {
      const bool finite = std::all_of(found[i].begin(), found[i].end(), [](const auto& k) {
        return k.at.allFinite() && std::isfinite(k.sigma);
      });
      vehicles[i].first->keypoints.clear();
      if (finite) vehicles[i].first->keypoints = to_observations(found[i], places[i]);
    }
    use.computed += static_cast<int>(vehicles.size());
  }
  const std::string source = fmt::format(
      "keypoints {}:{}", options.network == kShippedNetwork ? "shipped" : "network", use.hash);
  std::string& named = scene->detections_source;
  named = named.empty() ? source : named + ", " + source;
  if (progress) progress("keypoints", 1.0);
  return use;
}

}  // namespace camber
