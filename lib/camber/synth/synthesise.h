#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/core/stopwatch.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/scene/scene.h"
#include "camber/synth/data_set_layout.h"
#include "camber/synth/detections.h"
#include "camber/synth/render_view.h"
#include "camber/synth/scene_features.h"
#include "camber/synth/synth_world.h"
#include "camber/synth/view_camera.h"

namespace camber {

/// A scene to make.
struct SynthOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
  std::string name;     ///< of the scene; empty: the profile and the seed
  RoadProfileKind profile = RoadProfileKind::kSteepHill;
  int num_frames = 5;        ///< 1 to 1000
  double frame_rate = 10.0;  ///< Hz, (0, 100]
  double speed = 9.0;        ///< m/s of the camera's car, [0, 40]; not used at a corner
  PinholeCamera camera{1242, 375, 721.5377, 721.5377, 609.5593, 172.854};  ///< sides 16 to 4096 px
  /// Of the lens that the images and segmentations are seen through: then `camera` is that of the
  /// files, and the manifest's is undistorted_camera().
  LensModel lens = LensModel::kNone;
  std::vector<double> lens_coefficients;  ///< LensDistortion::coefficients
  double camera_height = 1.65;            ///< m above the road, [0.5, 4]
  int num_cars = 5;                       ///< at most; [0, 30]
  double nearest_car = 8.0;               ///< m ahead of the camera in the middle frame, [6, 100]
  double farthest_car = 45.0;             ///< m, (nearest_car, 100]
  SceneFeatures features;                 ///< corners, wet roads, kerbs and more
  CameraSensor sensor;                    ///< its seed is not used: see `seed`
  DetectorModel detector;                 ///< likewise
  int cloud_points = 60000;               ///< points of truth/road.ply, [0, 5 million]
  DataSetLayout layout;                   ///< of the files
  std::string command;                    ///< what made the scene, for its README.md; may be empty

  /// @throws std::invalid_argument naming the field, its value and the bound.
  void validate() const;
};

/// What was made.
struct SynthSummary {
  std::string name;    ///< of the scene
  int cars = 0;        ///< placed; fewer than asked for where there was no room
  int detections = 0;  ///< over all frames
  double speed = 0.0;  ///< m/s of the camera's car
  Timings timings;
};

/// Makes a scene folder: scene.json (camber-scene 1, with complete truth), images, simulated
/// segmentation and detections, truth/ (in the manifest's camera: depth of the first and the last
/// frame, labels, road cloud), run.json with the options, README.md. The truth's world is the first
/// frame's camera; the reference frame is the middle one.
///
/// A data set's layout adds its files: images, depth and labels of every frame as that data set
/// stores them (the manifest names these), the simulated boxes in KITTI's form, and of KITTI
/// tracking calibration, labels and keypoints.
///
/// Same options, same scene, for any number of threads, on machines of the same type.
/// @param folder     appears whole or not at all
/// @param overwrite  see AtomicFolder
/// @throws std::invalid_argument, OutputError, MachineError (ray casting cannot be started).
SynthSummary synthesise_scene(const SynthOptions& options, const std::filesystem::path& folder,
                              bool overwrite = false, const Progress& progress = {});

/// The options as run.json has them: lengths in m, angles as "..._deg", features that are on.
nlohmann::json options_json(const SynthOptions& options);

/// What the scene is seen with.
ViewCamera view_camera(const SynthOptions& options);

/// The options' part that makes the world.
WorldOptions world_options(const SynthOptions& options);

}  // namespace camber
