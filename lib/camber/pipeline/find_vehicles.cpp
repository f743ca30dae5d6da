#include "camber/pipeline/find_vehicles.h"

#include <algorithm>

namespace camber {
namespace {

/// Much of what the shipped detector finds is no vehicle, and other things have other proportions.
void keep_sure_ones(NetworkView* view) {
  for (auto& [id, vehicles] : view->vehicles) {
    vehicles.erase(std::remove_if(vehicles.begin(), vehicles.end(),
                                  [](const VehicleDetection& v) { return v.score < kSureScore; }),
                   vehicles.end());
  }
}

}  // namespace

VehicleFinder vehicle_finder(const NetworkChoice& networks, int num_threads,
                             const FramePixelSource& pixels) {
  DetectFramesOptions boxes = detect_options(networks, num_threads);
  boxes.networks.segmenter.clear();
  boxes.networks.segmenter_config.clear();
  boxes.pixels = pixels;
  FindKeypointsOptions keypoints = keypoint_options(networks, num_threads);
  keypoints.pixels = pixels;
  const bool by_shipped = networks.detector.empty();
  return [boxes, keypoints, by_shipped](const std::vector<int>& ids, Scene* scene) {
    if (!has_images(*scene, ids, boxes.pixels)) return;
    DetectFramesOptions detect = boxes;
    if (by_shipped && !has_boxes(*scene)) detect.networks.detector = kShippedNetwork;
    if (!detect.networks.empty()) {
      NetworkView view = detect_frames(*scene, ids, detect);
      if (detect.networks.detector_ships()) keep_sure_ones(&view);
      put_network_view(view, scene);
    }
    find_keypoints(scene, ids, keypoints);
  };
}

}  // namespace camber
