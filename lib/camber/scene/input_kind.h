#pragma once

#include <filesystem>
#include <string>

namespace camber {

/// What a person hands to a command that works on a scene.
enum class InputKind {
  kScene,   ///< a manifest, or a folder with a scene.json
  kVideo,   ///< a film, by its name's extension
  kImages,  ///< a folder with images and no manifest
  kBag      ///< a recording: a bag of ROS 1, MCAP or rosbag2, by its name's extension
};
/// "scene", and as the commands of camber import have it: "video", "images", "rosbag".
std::string to_string(InputKind kind);

/// By what is at `path`; what is not there and what nothing is known of is taken for a scene, whose
/// reader names what it expected.
InputKind kind_of_input(const std::filesystem::path& path);

}  // namespace camber
