#pragma once

#include <filesystem>
#include <vector>

#include "camber/core/progress.h"
#include "camber/detect/keypoint_evaluation.h"
#include "camber/scene/scene.h"

namespace camber {

/// Which vehicles of a scene's truth keypoints are judged on.
struct KeypointTruthOptions {
  double least_height = 40.0;         ///< px, of the true box
  double most_occlusion = 0.5;        ///< share
  double most_truncation = 0.3;       ///< share
  int crop_size = kKeypointCropSize;  ///< px, KeypointNetwork::crop_size()
  int num_threads = 0;                ///< <= 0: see resolve_num_threads
};

struct SceneKeypointTruth {
  std::vector<KeypointCropTruth> crops;
  /// What is hidden is known by ray casting (keypoints_visible of truth/truth.json beside the
  /// manifest); else by the side that the vehicle shows.
  bool by_ray_casting = false;
};

/// Crops of the true boxes, clipped to the image, of all frames that have an image, with the
/// truth's keypoints projected into them. Truth: for evaluation only.
/// @param folder  of the manifest.
/// @throws InputError for images and a truth/truth.json that cannot be read.
SceneKeypointTruth scene_keypoint_truth(const Scene& scene, const std::filesystem::path& folder,
                                        const KeypointTruthOptions& options,
                                        const LogSink& warn = {});

}  // namespace camber
