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
  fs::path manifest = run.scene;
  if (!fs::exists(manifest, error)) {
    // A result that was moved takes the scene that it holds with it.
    if (fs::exists(folder / "scene" / "scene.json", error)) {
      manifest = folder / "scene" / "scene.json";
    } else {
      *missing = "the scene of this run is no longer at " + run.scene;
      return std::nullopt;
    }
  }
  if (paths == ScenePaths::kAnywhere) {
    return read_referred_file(manifest, "a scene manifest", warn, [&](const LogSink& sink) {
      return std::optional(read_scene(manifest, sink));
    });
  }
  if (!lies_below(manifest, folder)) {
    *missing = "the scene of this run lies outside the result's folder (--confine)";
    return std::nullopt;
  }
  return read_scene(manifest, warn, paths);
}

}  // namespace camber
