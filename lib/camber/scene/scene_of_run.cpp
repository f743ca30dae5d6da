#include "camber/scene/scene_of_run.h"

#include "camber/core/referred_file.h"

namespace fs = std::filesystem;

namespace camber {

std::optional<Scene> read_scene_of_run(const RunDocument& run, const fs::path& folder,
                                       const LogSink& warn, ScenePaths paths,
                                       std::string* missing) {
  missing->clear();
  if (run.scene.empty()) return std::nullopt;
  std::error_code error;
  if (!fs::exists(run.scene, error)) {
    *missing = "the scene of this run is no longer at " + run.scene;
    return std::nullopt;
  }
  if (paths == ScenePaths::kAnywhere) {
    return read_referred_file(run.scene, "a scene manifest", warn, [&](const LogSink& sink) {
      return std::optional(read_scene(run.scene, sink));
    });
  }
  if (!lies_below(run.scene, folder)) {
    *missing = "the scene of this run lies outside the result's folder (--confine)";
    return std::nullopt;
  }
  return read_scene(run.scene, warn, paths);
}

}  // namespace camber
