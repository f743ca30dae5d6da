#include "camber/pipeline/find_vehicles.h"

namespace camber {

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
    if (!detect.networks.empty()) put_network_view(detect_frames(*scene, ids, detect), scene);
    find_keypoints(scene, ids, keypoints);
  };
}

}  // namespace camber
