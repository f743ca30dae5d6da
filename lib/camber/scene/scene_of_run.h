#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// Reads the scene that a run names (`scene` of run.json), where it names one.
/// @param folder   of the result.
/// @param paths    kConfined: the manifest must lie in the result's folder, and what it names in
///                 the manifest's.
/// @param missing  why there is none: the path that is no longer there, or is not allowed.
/// @throws InputError where it is there and is no manifest.
std::optional<Scene> read_scene_of_run(const RunDocument& run, const std::filesystem::path& folder,
                                       const LogSink& warn, ScenePaths paths, std::string* missing);

}  // namespace camber
