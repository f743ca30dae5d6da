#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/calibrate/calibrate_drive.h"
#include "camber/scene/scene.h"

namespace camber {

/// The calibration as a file of OpenCV's FileStorage (YAML): camera_matrix,
/// distortion_coefficients, and beside them focal_sigma (relative), principal_sigma (px),
/// distortion_sigma (of k1), the mounting in degrees with its sigmas, and what
/// decided. read_calibration() reads it.
/// @param source  what it was made of, for a comment.
std::string calibration_yaml(const DriveCalibration& calibration, const std::string& source);

/// What was found as JSON, numbers with their sigma: px, degrees, relative.
nlohmann::json to_json(const DriveCalibration& calibration);

/// The scene with that camera, its lens taken out on reading; boxes and keypoints, which stand in
/// the pixels of the camera that the scene had, are carried over. A height that the scene has
/// stays; one by its own speeds or positions is not put into it, since these are there already.
Scene calibrated_scene(const Scene& scene, const DriveCalibration& calibration);

}  // namespace camber
