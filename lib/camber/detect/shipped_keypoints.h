#pragma once

#include <string>

#include "camber/detect/network.h"

namespace camber {

/// The name by which the network that ships is asked for, in place of a file's.
inline constexpr const char* kShippedNetwork = "shipped";

/// The keypoint network that ships, put into the library by the build (models/README.md).
OnnxFile shipped_keypoint_network();
/// Its side file's text.
std::string shipped_keypoint_description();

}  // namespace camber
