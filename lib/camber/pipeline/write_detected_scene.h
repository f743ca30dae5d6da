#pragma once

#include <filesystem>
#include <vector>

#include "camber/pipeline/detect_frames.h"

namespace camber {

/// The files of a scene whose frames networks have looked at: the label images, in the folder
/// STEM-segmentation beside the manifest STEM.json, and the manifest.
std::vector<std::filesystem::path> detected_scene_files(const NetworkView& view,
                                                        const std::filesystem::path& manifest);

/// Writes the scene with what the networks saw in its frames: all files or none.
/// @param scene  with put_network_view() done. @throws OutputError.
/// @return the scene as written.
Scene write_detected_scene(Scene scene, const NetworkView& view,
                           const std::filesystem::path& manifest);

}  // namespace camber
