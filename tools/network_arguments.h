#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/pipeline/detect_frames.h"
#include "camber/pipeline/find_keypoints.h"
#include "options.h"

namespace camber::tools {

/// The networks that a command runs on a scene's images.
struct NetworkArguments {
  std::string detector, detector_config, segmenter, segmenter_config, cache;
  std::string keypoints, keypoints_config;  ///< keypoints empty: shipped, where none are given
  bool no_cache = false;

  /// Whether the shipped detector may keep vehicles out of the road where the scene shows none.
  bool may_mask() const { return detector.empty() && segmenter.empty(); }
};

void add_network_options(App& app, NetworkArguments& arguments);

/// @throws UsageError for a side file without its network.
DetectFramesOptions detect_options(const NetworkArguments& arguments, int num_threads);

/// Of --keypoints: shipped, none or a file; without it the shipped network where the scene has no
/// keypoints. @throws UsageError for a side file without its network.
FindKeypointsOptions keypoint_options(const NetworkArguments& arguments, int num_threads);

/// What the networks are read from.
std::vector<std::filesystem::path> files_of(const NetworkFiles& networks);
std::vector<std::filesystem::path> files_of(const FindKeypointsOptions& keypoints);

/// For --json and run.json: file, hash, name, layers, images computed and taken from the cache.
/// @param masking  the detector whose boxes only keep vehicles out of the road.
nlohmann::json network_json(const NetworkView& view, const std::optional<NetworkUse>& keypoints,
                            const std::optional<NetworkUse>& masking = {});

/// Lines for a person: what was found, and that a network's layers are not joined.
std::string describe(const NetworkView& view, const std::optional<NetworkUse>& keypoints);

}  // namespace camber::tools
