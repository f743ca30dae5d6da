#include "camber/import/open_scene.h"

#include <utility>

#include "camber/core/errors.h"
#include "camber/core/made_folder.h"

namespace fs = std::filesystem;

namespace camber {

OpenedScene open_scene(const fs::path& path, const OpenSceneOptions& options, const LogSink& warn) {
  OpenedScene out;
  out.kind = kind_of_input(path);
  if (out.kind == InputKind::kScene) {
    std::error_code error;
    out.manifest = fs::is_directory(path, error) ? path / "scene.json" : path;
    out.scene = read_scene(path, warn, options.paths);
    return out;
  }
  out.manifest = options.import_to / "scene.json";
  const auto import = [&]() -> OwnImport {
    switch (out.kind) {
      case InputKind::kVideo:
        return import_video(path, options.video, options.own, out.manifest);
      case InputKind::kBag: {
        if (!options.open_bag) {
          throw InputError(path.string(), "found a bag, expected a scene, a film or images");
        }
        BagChoice choice;
        choice.frames = options.video;
        return import_rosbag(options.open_bag(path), path, choice, options.own, out.manifest);
      }
      default:
        return import_images({path.string()}, options.own, warn);
    }
  };
  OwnImport made = import();
  MadeFolder folder(options.import_to);
  write_own_import(made, out.manifest);
  folder.keep();
  out.scene = std::move(made.scene);
  out.found = std::move(made.found);
  out.missing = std::move(made.missing);
  out.telemetry = std::move(made.telemetry);
  out.camera_guessed = made.camera_guessed;
  return out;
}

}  // namespace camber
