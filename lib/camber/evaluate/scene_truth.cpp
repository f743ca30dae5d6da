#include "camber/evaluate/scene_truth.h"

#include <fmt/format.h>

#include <vector>

#include "camber/core/errors.h"
#include "camber/evaluate/depth_truth.h"
#include "camber/image/image_io.h"
#include "camber/import/import_synthia.h"

namespace camber {

int frame_of_result(const std::optional<RunDocument>& run, const Scene& scene) {
  if (run) {
    for (const RunDocument::CameraPose& camera : run->cameras) {
      if (camera.reference_from_camera.matrix().isIdentity(1e-9)) return camera.id;
    }
  }
  std::vector<int> ids;
  for (const SceneFrame& frame : scene.frames) ids.push_back(frame.id);
  return choose_reference_frame(scene, ids);
}

Shape ground_of_true_depth(const std::string& name, const Scene& scene, int frame) {
  constexpr double kLargest = 100.0;  // m
  for (const TruthFrame& truth : scene.truth->frames) {
    if (truth.id != frame || truth.depth.empty()) continue;
    const DepthImage depth = read_depth_image(truth.depth, truth.depth_encoding, scene.camera);
    std::optional<Image> labels;
    if (truth.depth_encoding == "synthia" && !truth.label.empty()) {
      labels = read_label_image(truth.label, scene.camera);
    }
    Shape ground =
        ground_mesh_from_depth(depth, scene.camera, labels ? &*labels : nullptr,
                               {kSynthiaRoad, kSynthiaSidewalk, kSynthiaRoadLines}, kLargest);
    if (!ground.is_mesh()) {
      throw NoAnswerError(fmt::format("{}: no ground in the depth of frame {}", name, frame));
    }
    return ground;
  }
  throw NoAnswerError(
      fmt::format("{}: the scene has no truth cloud and no true depth of frame {}", name, frame));
}

Eigen::Matrix4d frame_from_truth_cloud(const std::string& name, const Scene& scene, int frame) {
  if (scene.truth->cloud_frame && *scene.truth->cloud_frame == frame) {
    return Eigen::Matrix4d::Identity();
  }
  const auto pose = [&](int id) {
    for (const TruthFrame& truth : scene.truth->frames) {
      if (truth.id == id && truth.world_from_camera) return *truth.world_from_camera;
    }
    throw NoAnswerError(fmt::format("{}: no true pose of frame {}", name, id));
  };
  SE3 world_from_cloud;
  if (scene.truth->cloud_frame) world_from_cloud = pose(*scene.truth->cloud_frame);
  return (pose(frame).inverse() * world_from_cloud).matrix();
}

}  // namespace camber
