#pragma once

#include <filesystem>
#include <vector>

#include "camber/scene/scene.h"
#include "options.h"

namespace camber::tools {

/// `--confine`: of a scene from a stranger, as a service gets them.
void add_confine_option(App& app, bool& confine);
ScenePaths scene_paths(bool confine);

/// The files that a scene names: images, segmentations, masks, truth.
std::vector<std::filesystem::path> files_of(const Scene& scene);

/// Before the work: throws a UsageError if an output is one of the inputs, under this name or any
/// other (links). Of a folder among the inputs that is a scene, a result or a COLMAP model, its
/// files; an OutputError if an output cannot be written. Empty names are skipped.
void refuse_own_inputs(const std::vector<std::filesystem::path>& outputs,
                       const std::vector<std::filesystem::path>& inputs);

}  // namespace camber::tools
