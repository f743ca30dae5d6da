#pragma once

#include "command.h"

namespace camber::tools {

/// Adds run and evaluate to `camber keypoints`.
void add_keypoint_network_commands(App& keypoints);

}  // namespace camber::tools
