#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/import/import_own.h"
#include "camber/import/import_rosbag.h"
#include "camber/scene/input_kind.h"
#include "camber/scene/scene.h"

namespace camber {

struct OpenSceneOptions {
  OwnDataOptions own;  ///< of what is no scene
  VideoChoice video;   ///< of films and bags
  /// Where the scene of what is none is written, with scene.json; an earlier import there is
  /// replaced.
  std::filesystem::path import_to;
  ScenePaths paths = ScenePaths::kAnywhere;
  /// Opens a bag; empty: bags are refused.
  std::function<std::shared_ptr<BagReader>(const std::filesystem::path&)> open_bag;
};

/// A scene as it was read or imported.
struct OpenedScene {
  Scene scene;
  InputKind kind = InputKind::kScene;
  std::filesystem::path manifest;           ///< that was read, or written
  std::vector<std::string> found, missing;  ///< OwnImport's; empty for a scene
  std::string telemetry;                    ///< OwnImport's
  bool camera_guessed = false;              ///< OwnImport's
};

/// Reads a scene, or makes one of a film, a folder of images or a bag on the way.
/// @param warn  as for read_scene().
/// @throws InputError, UsageError; OutputError where the import cannot be written.
OpenedScene open_scene(const std::filesystem::path& path, const OpenSceneOptions& options,
                       const LogSink& warn = {});

}  // namespace camber
