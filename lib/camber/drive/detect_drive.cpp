#include "camber/drive/detect_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "camber/pipeline/stages/load.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

std::vector<int> readable(const Scene& scene, const std::vector<int>& frame_ids) {
  stages::FrameLoader loader(scene, {});
  std::vector<int> out;
  for (const int id : frame_ids) {
    try {
      loader.load(id);
      out.push_back(id);
    } catch (const InputError&) {
      continue;
    } catch (const NoAnswerError&) {
      continue;  // a frame without an image
    }
  }
  return out;
}

/// The labels of frames as images in a folder, which the scene names from then on.
void put_labels(const std::map<int, Image>& labels, const fs::path& folder, Scene* scene) {
  for (SceneFrame& frame : scene->frames) {
    const auto found = labels.find(frame.id);
    if (found == labels.end()) continue;
    frame.segmentation = folder / fmt::format("{:06}.png", frame.id);
    write_png(found->second, frame.segmentation);
  }
}

void add(const std::optional<NetworkUse>& part, std::optional<NetworkUse>* whole) {
  if (!part || !*whole) {
    if (part) *whole = part;
    return;
  }
  (*whole)->computed += part->computed;
  (*whole)->cached += part->cached;
}

/// What the networks see in the frames, some at a time: their labels are written down, and dropped.
NetworkView see(const std::vector<int>& ids, const DetectFramesOptions& networks,
                const fs::path& labels, const Progress& progress, const LogSink& warn,
                Scene* scene) {
  if (networks.networks.segmenter.empty()) {
    return detect_frames(*scene, ids, networks, progress, warn);
  }
  constexpr std::size_t kAtOnce = 16;
  std::error_code error;
  fs::create_directories(labels, error);
  if (error) throw OutputError(labels.string(), error.message());
  for (SceneFrame& frame : scene->frames) frame.segmentation.clear();  // another source's
  NetworkView out;
  for (std::size_t first = 0; first < ids.size(); first += kAtOnce) {
    const std::size_t last = std::min(first + kAtOnce, ids.size());
    const Progress part = [&](const std::string& stage, double share) {
      const double done = static_cast<double>(first) + share * static_cast<double>(last - first);
      if (progress) progress(stage, done / static_cast<double>(ids.size()));
    };
    const std::vector<int> some(ids.begin() + static_cast<std::ptrdiff_t>(first),
                                ids.begin() + static_cast<std::ptrdiff_t>(last));
    // Warnings are of the networks: once.
    NetworkView view = detect_frames(*scene, some, networks, part, first == 0 ? warn : LogSink());
    put_labels(view.labels, labels, scene);
    out.vehicles.merge(view.vehicles);
    add(view.detector, &out.detector);
    add(view.segmenter, &out.segmenter);
    out.box_sigma_px = view.box_sigma_px;
    out.classes = std::move(view.classes);
  }
  return out;
}

}  // namespace

DriveNetworks detect_drive(Scene* scene, const std::vector<int>& frame_ids,
                           const DetectFramesOptions& networks,
                           const FindKeypointsOptions& keypoints, const fs::path& labels,
                           const Progress& progress, const LogSink& warn) {
  DriveNetworks out;
  const auto look = [&](const std::vector<int>& ids) {
    if (!networks.networks.empty()) {
      out.view = see(ids, networks, labels, progress, warn, scene);
      put_network_view(out.view, scene);
      out.view.vehicles.clear();
    }
    out.keypoints = find_keypoints(scene, ids, keypoints, progress, warn);
  };
  const Scene before = *scene;
  try {
    look(frame_ids);
  } catch (const InputError&) {
    const std::vector<int> ids = readable(before, frame_ids);
    if (ids.size() == frame_ids.size()) throw;  // a network
    *scene = before;
    look(ids);
  }
  return out;
}

}  // namespace camber
