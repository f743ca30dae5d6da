#pragma once

#include <string>

#include "camber/detect/network.h"

namespace camber {

/// The name by which a network that ships is asked for, in place of a file's.
inline constexpr const char* kShippedNetwork = "shipped";

/// The keypoint network that ships, put into the library by the build (models/README.md).
OnnxFile shipped_keypoint_network();
/// Its side file's text.
std::string shipped_keypoint_description();

/// The network that finds vehicles, trained on made pictures alone, likewise.
OnnxFile shipped_detector();
std::string shipped_detector_description();

}  // namespace camber
