#pragma once

#include <filesystem>
#include <vector>

#include "camber/scene/scene.h"

namespace camber {

/// The files that a scene names: images (of a frame of a film, the film), segmentations, masks,
/// truth. Those that are not named are empty.
std::vector<std::filesystem::path> files_of(const Scene& scene);

}  // namespace camber
