#pragma once

#include <filesystem>

#include "camber/scene/scene.h"

namespace camber::test {

/// A scene of half the width and height and the same field of view: images averaged over 2 x 2
/// pixels, label images thinned, boxes (the truth's too) and keypoints halved, no depth images. For
/// tests of what does not hang on the last of the accuracy.
/// @param folder  its images are written there.
Scene half_size(const Scene& scene, const std::filesystem::path& folder);

}  // namespace camber::test
