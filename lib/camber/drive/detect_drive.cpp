#include "camber/drive/detect_drive.h"

#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/load.h"

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

}  // namespace

DriveNetworks detect_drive(Scene* scene, const std::vector<int>& frame_ids,
                           const DetectFramesOptions& networks,
                           const FindKeypointsOptions& keypoints, const Progress& progress,
                           const LogSink& warn) {
  if (!networks.networks.segmenter.empty()) {
    throw std::invalid_argument("detect_drive: a segmenter is for a few frames");
  }
  DriveNetworks out;
  const auto look = [&](const std::vector<int>& ids) {
    if (!networks.networks.empty()) {
      out.view = detect_frames(*scene, ids, networks, progress, warn);
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
