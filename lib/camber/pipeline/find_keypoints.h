#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/detect/keypoint_network.h"
#include "camber/detect/shipped_networks.h"
#include "camber/pipeline/detect_frames.h"
#include "camber/scene/scene.h"

namespace camber {

/// Which vehicles of a scene the keypoint network looks at.
enum class KeypointChoice {
  kNone,
  /// All, if no vehicle of the frames has keypoints (another network's are not mixed with them) and
  /// the frames have images; else none.
  kMissing,
  kAll  ///< keypoints that are there are replaced
};

struct FindKeypointsOptions {
  KeypointChoice choice = KeypointChoice::kMissing;
  std::filesystem::path network = kShippedNetwork;  ///< ONNX file, or the one that ships
  std::filesystem::path config;                     ///< empty: beside the network, .json
  int num_threads = 0;                              ///< <= 0: see resolve_num_threads
  FramePixelSource pixels;  ///< images in memory, as stages::LoadOptions has them
};

/// Loads the keypoint network of a file, or the one that ships.
/// @throws InputError.
KeypointNetwork open_keypoint_network(const std::filesystem::path& network,
                                      const std::filesystem::path& config,
                                      const LogSink& warn = {});

/// Puts the network's keypoints, with their sigmas, into the vehicles of frames whose class has a
/// shape prior (others are placed without keypoints), and names the network in the scene's
/// detections_source. Crops are cut from the undistorted images.
/// @param frame_ids  ids of the scene.
/// @return  what was used, images in it being crops; nothing if no vehicle was looked at.
/// @throws InputError for images, networks and side files that cannot be read; NoAnswerError for a
///         frame without an image, of kAll.
std::optional<NetworkUse> find_keypoints(Scene* scene, const std::vector<int>& frame_ids,
                                         const FindKeypointsOptions& options,
                                         const Progress& progress = {}, const LogSink& warn = {});

}  // namespace camber
