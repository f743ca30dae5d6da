#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/calibrate/calibrate_drive.h"

namespace camber {

/// Whether nobody calibrated the camera of a scene: of all that could be wrong with it only the
/// focal length's doubt is stated, and that is more than twice what a drive leaves
/// (LensEstimateOptions::focal_floor). A camera of calibrate_drive() is none.
bool camera_is_guessed(const Scene& scene);

/// The guess as what is known before: the scene's focal length with its doubt, the rest as of cars.
LensPrior lens_prior_of(const Scene& scene);

/// What a drive showed of a guessed camera.
struct CameraByDrive {
  std::optional<Scene> scene;                   ///< with the drive's camera; none: the guess stays
  std::optional<DriveCalibration> calibration;  ///< also where it measures too little
  std::string text;                             ///< a sentence: what was done, and what it gave
  double milliseconds = 0.0;
};

/// Calibrates a guessed camera by its drive. The guess is the prior of that one estimate, so it is
/// in the result, and nothing is joined with it afterwards. It stays where there are fewer than
/// three windows, whose spread shows how well they know the camera, where the focal length would
/// not be clearly better known, and where no image can be read.
/// @param frame_ids  ascending ids of the scene.
/// @param options    `prior`, `skip_unreadable` and `sizes_from` are its own.
CameraByDrive calibrate_guessed(const Scene& scene, const std::vector<int>& frame_ids,
                                const CalibrateOptions& options,
                                const FramePixelSource& pixels = {}, const Progress& progress = {});

/// For run.json: `used`, `text`, and what was found, each number with its sigma.
nlohmann::json to_json(const CameraByDrive& camera);

}  // namespace camber
