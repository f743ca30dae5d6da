#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "camber/cloud/cloud_io.h"
#include "camber/render/pictures.h"

namespace camber {

/// What a picture, a report or a viewer shows: a result folder or a single cloud, in memory.
struct LoadedResult {
  std::filesystem::path path;
  std::optional<RoadCloud> cloud;
  std::optional<RoadSurface> surface;
  std::optional<VehicleDocument> vehicles;
  std::optional<RunDocument> run;
  std::optional<Scene> scene;            ///< of the run, where it was given: camera, images, truth
  std::optional<RoadCloud> truth_cloud;  ///< dense ground truth, where it was asked for
  SE3 reference_from_truth_cloud;
  ReadReport cloud_report;

  /// The frame that is the result's reference: the camera with the identity pose, else the one in
  /// the middle of the vehicle document, else 0.
  int reference_frame() const;

  /// Reads the truth cloud of the scene and finds the transform to the reference camera.
  /// @throws NoAnswerError where the scene has no truth cloud, or no pose that joins it;
  /// InputError.
  void load_scene_truth_cloud(const ReadOptions& options = {});

  /// Reads the scene that the run names (`scene` of run.json), where it names one.
  /// @param paths  kConfined: the manifest must lie in the result's folder, too.
  /// @return  empty, or why there is none: the path that is no longer there or not allowed.
  /// @throws InputError where it is there and is no manifest.
  std::string load_scene_of_run(const LogSink& warn = {}, ScenePaths paths = ScenePaths::kAnywhere);

  /// Pointers into this object, which must outlive them; the reference frame is shown.
  PictureContent content() const;
};

/// Reads a result folder (run.json must be there; road.ply, surface.json and vehicles.json where
/// they are; of a surface in tiles with options.bounds the patches that reach into these, in
/// metres) or, from a file, a cloud or (.json) vehicles alone, as camber vehicles writes them.
/// @throws InputError "file: position: found, expected".
LoadedResult load_result(const std::filesystem::path& path, const ReadOptions& options = {});

}  // namespace camber
