#pragma once

#include <filesystem>
#include <vector>

#include "camber/scene/scene_files.h"
#include "command.h"

namespace camber::tools {

/// `--confine`: of a scene from a stranger, as a service gets them.
void add_confine_option(App& app, bool& confine);
ScenePaths scene_paths(bool confine);

/// Before the work: throws a UsageError if an output of the command line is one of its inputs,
/// under this name or any other (links), or is a folder that holds one and would be replaced, or if
/// two outputs are one file. From then on none of the inputs is replaced. Of a folder among them
/// that is a scene, a result or a COLMAP model, that goes for its files.
void refuse_own_inputs(const Command& command);

/// The same of files that are known only once the command looks at its inputs; an OutputError if an
/// output cannot be written. Empty names are skipped.
void refuse_own_inputs(const std::vector<std::filesystem::path>& outputs,
                       const std::vector<std::filesystem::path>& inputs);

}  // namespace camber::tools
