#pragma once

#include <string>

#include "camber/scene/scene.h"
#include "camber/synth/synthesise.h"

namespace camber {

/// The README.md of a made scene.
std::string scene_readme(const SynthOptions& options, const Scene& scene, const SynthWorld& world);

}  // namespace camber
