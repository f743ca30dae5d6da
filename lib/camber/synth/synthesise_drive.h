#pragma once

#include <optional>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/synth/synthesise.h"

namespace camber {

/// A whole drive to make: a road of any length with hills, bends, corners and banks, traffic,
/// standstills.
struct SynthDriveOptions {
  /// Seed, frames (1 to 100,000), rate, speed (m/s, of the drive where it is free, > 0), camera,
  /// roadside, asphalt, markings, weather, sensor, detector. The camera and its height are what the
  /// manifest states. Profile, cars, corner, bend, lead car, lens, cloud points and data set
  /// layouts are not used.
  SynthOptions scene;
  /// world_from_camera of each frame that the drive follows in plan, height and speed (roll, pitch
  /// and what is tighter than 11 m are its own), m; none: a road is drawn.
  std::optional<std::vector<SE3>> path;
  std::optional<int> standstills;  ///< >= 0; else drawn, about one in 300 frames. Not with a path.
  double height_sigma = 0.02;      ///< m, stated; the true height differs by a draw of it, >= 0
  /// Relative, of the focal length; where > 0 the true one of half of the seeds differs by a draw.
  double focal_sigma = 0.0;
  double traffic = 1.0;          ///< density of cars, 0 to 5
  double cloud_density = 150.0;  ///< points of truth/road.ply a metre of road, 0 to 10,000

  /// @throws std::invalid_argument naming the field, its value and the bound.
  void validate() const;
};

struct SynthDriveSummary {
  SynthSummary scene;
  double length = 0.0;            ///< m, of the camera's true steps
  double true_height = 0.0;       ///< m
  double true_focal_ratio = 1.0;  ///< true over stated focal length
  int standstills = 0;
};

/// Makes a drive: a scene folder as synthesise_scene() does, with true vehicles whose ids stay
/// theirs, truth/road.ply along the whole road, and no depth. The world's stretch around the camera
/// is made and rendered at a time: memory does not grow with the length but for the manifest.
/// Same options, same drive, for any number of threads, on machines of the same type.
/// @throws as synthesise_scene().
SynthDriveSummary synthesise_drive(const SynthDriveOptions& options,
                                   const std::filesystem::path& folder, bool overwrite = false,
                                   const Progress& progress = {});

/// The options as run.json has them.
nlohmann::json options_json(const SynthDriveOptions& options);

}  // namespace camber
