#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/pipeline/detect_frames.h"
#include "camber/pipeline/find_keypoints.h"

namespace camber {

/// For a detector or keypoint network that is not to run.
inline constexpr const char* kNoNetwork = "none";

/// The folder that keeps results of networks unless another is named: $CAMBER_CACHE,
/// $XDG_CACHE_HOME/camber or ~/.cache/camber; empty where none of them is known.
std::filesystem::path default_network_cache();

/// The networks of a run, as a person names them.
struct NetworkChoice {
  std::string detector;   ///< kShippedNetwork, an ONNX file or kNoNetwork; empty: not chosen
  std::string segmenter;  ///< ONNX file; empty: none
  std::string keypoints;  ///< kShippedNetwork, an ONNX file or kNoNetwork; empty: the one that
                          ///< ships, where no vehicle of the frames has keypoints
  std::string detector_config, segmenter_config, keypoints_config;  ///< empty: beside the network
  std::filesystem::path cache = default_network_cache();            ///< empty: nothing is kept

  /// Whether the shipped detector may keep vehicles out of the road where the scene shows none.
  bool may_mask() const { return detector.empty() && segmenter.empty(); }
  /// @throws std::invalid_argument for a description without its network.
  void validate() const;
};

DetectFramesOptions detect_options(const NetworkChoice& choice, int num_threads);
FindKeypointsOptions keypoint_options(const NetworkChoice& choice, int num_threads);

/// What networks are read from; nothing for those that ship.
std::vector<std::filesystem::path> files_of(const NetworkChoice& choice);

/// For run.json: file, hash, name, layers, images computed and taken from the cache.
/// @param masking  the detector whose boxes only keep vehicles out of the road.
nlohmann::json network_json(const NetworkView& view, const std::optional<NetworkUse>& keypoints,
                            const std::optional<NetworkUse>& masking = {});

/// Lines for a person: what was found, and that a network's layers are not joined.
std::string describe(const NetworkView& view, const std::optional<NetworkUse>& keypoints);

}  // namespace camber
