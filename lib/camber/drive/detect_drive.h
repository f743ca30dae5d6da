#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "camber/core/progress.h"
#include "camber/pipeline/detect_frames.h"
#include "camber/pipeline/find_keypoints.h"
#include "camber/scene/scene.h"

namespace camber {

/// What networks saw in the frames of a drive.
struct DriveNetworks {
  NetworkView view;                     ///< no vehicles: they are in the scene
  std::optional<NetworkUse> keypoints;  ///< of the vehicles that have a shape prior
};

/// Puts boxes of the detector and labels of the segmenter, where one is given, and keypoints into
/// the frames of a scene. Few images are held at once; frames that cannot be read have no vehicles
/// and no labels.
/// @param labels  folder of the label images, made where it is not there; of a segmenter alone.
/// @throws as detect_frames() and find_keypoints() for networks; OutputError.
DriveNetworks detect_drive(Scene* scene, const std::vector<int>& frame_ids,
                           const DetectFramesOptions& networks,
                           const FindKeypointsOptions& keypoints,
                           const std::filesystem::path& labels, const Progress& progress = {},
                           const LogSink& warn = {});

}  // namespace camber
