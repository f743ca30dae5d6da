#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/drive/drive_surface.h"
#include "camber/drive/run_drive.h"
#include "camber/pipeline/network_choice.h"
#include "camber/scene/json_value.h"
#include "camber/scene/scene.h"

namespace camber {

/// A drive with what goes around it: networks, checkpoint, files and pictures.
struct DriveSceneOptions {
  DriveOptions drive;
  NetworkChoice networks;          ///< without a segmenter: UsageError
  std::string frames;              ///< as select_frames(); empty: all
  bool calibrates = true;          ///< a guessed camera (camera_is_guessed()) by all its frames
  bool pictures = true;            ///< film, plots and report
  std::filesystem::path film;      ///< .mp4 or .avi; empty: film.mp4 in the folder
  bool overwrite = false;          ///< also replace a foreign folder that is not empty
  bool resume = false;             ///< go on with what an interrupted run of the same drive left
  std::string command;             ///< for run.json
  std::filesystem::path manifest;  ///< of the scene, as run.json names it
  std::string manifest_hash;       ///< of its content: part of what must be equal to resume
  std::vector<std::filesystem::path>
      inputs;  ///< what was read: no folder that holds it is replaced
  /// Adds files of the caller's to the folder before the run is marked as complete, and the scene
  /// as `scene/scene.json`, where its camera was calibrated (else null). Empty: that scene alone.
  std::function<void(const std::filesystem::path& folder, const Scene* calibrated)> add_files;
  /// Writes the drive's place on the map into a file, where it has one; may be empty.
  std::function<void(const DriveResult&, const DriveSurface&, const std::filesystem::path&)> gpx;
  LogSink notice;  ///< a sentence for whatever was decided on the way; may be empty
  LogSink warn;    ///< what is wrong with networks' descriptions; may be empty
};

/// What a drive came to.
struct DriveOutcome {
  JsonValue run;           ///< run.json
  bool was_there = false;  ///< complete already, and `resume` was given: nothing was done
};

/// What `camber drive` computes and writes of a scene. With `resume` a complete result of equal
/// inputs stays as it is.
/// @throws UsageError, InputError, NoAnswerError, OutputError; InterruptedError: what was measured
///         stays in the folder.
DriveOutcome drive_scene(const Scene& scene, const std::filesystem::path& folder,
                         const DriveSceneOptions& options, const Progress& progress = {});

}  // namespace camber
