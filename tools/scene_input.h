#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/made_folder.h"
#include "camber/import/open_scene.h"
#include "camera_arguments.h"
#include "command.h"
#include "gnss_arguments.h"

namespace camber::tools {

/// What a command works on: a scene, or a film, a folder of images or a bag with what is known of
/// its camera.
struct SceneInputArguments {
  std::string path;
  CameraArguments camera;
  TelemetryArguments telemetry;
  double rate = 0.0;  ///< frames a second of images; 0: not given
  bool confine = false;
};

/// The positional argument, the camera's options and --confine.
void add_scene_input(App& app, SceneInputArguments& arguments);

/// The same of a command that takes several; whether any is given is the command's to check.
void add_scene_inputs(App& app, SceneInputArguments& arguments, std::vector<std::string>& paths);

/// --no-calibrate: a camera that is guessed stays so.
void add_calibrate_option(App& app, bool& no_calibrate);

/// The scene of a command whose result is a folder. What is imported on the way stands in a hidden
/// folder beside the result until keep_in() puts it there as scene/; without that nothing remains.
class SceneInput {
 public:
  /// Reads or imports; states on stderr what was made of a film, unless --quiet.
  /// @param out  the result's folder.
  /// @throws UsageError for options of a camera beside a scene, which has its own.
  SceneInput(const Command& command, const SceneInputArguments& arguments,
             const std::filesystem::path& out);

  const OpenedScene& opened() const { return opened_; }
  /// The result is of the scene with another camera: that is kept, also of a manifest.
  void recalibrate(Scene scene);
  /// Whether a scene is kept with the result.
  bool is_kept() const { return calibrated_ || !imported_.empty(); }
  /// Where the manifest will be found, absolute.
  const std::filesystem::path& manifest() const { return manifest_; }
  /// The name that a file has once the import is kept: that of others stays.
  std::string kept_name(const std::string& file) const;
  /// Moves what is kept into the folder that becomes the result.
  void keep_in(const std::filesystem::path& staging);

 private:
  OpenedScene opened_;
  std::optional<Scene> calibrated_;
  std::filesystem::path manifest_, kept_;  // kept_: where the result's own scene will be
  std::filesystem::path imported_;         // folder of the import; empty: none
  std::unique_ptr<MadeFolder> parent_, work_;
};

}  // namespace camber::tools
