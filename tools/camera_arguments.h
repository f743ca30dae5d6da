#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/import/import_own.h"
#include "options.h"

namespace camber::tools {

/// The camera of one's own images as typed, and how high it is above the road.
struct CameraArguments {
  static constexpr double kNone = -1e300;

  std::string calibration, name;
  bool rectified = false;
  double fx = 0, fy = 0, cx = kNone, cy = kNone;  ///< 0, kNone: not given
  double fov = 0, fov_sigma = 0;
  double height = 0, height_sigma = 0;

  /// The options of the library from what was typed.
  void take(OwnDataOptions* options) const;
  /// For --json: what was typed, null what was not.
  void add_json(nlohmann::json* options) const;
};

enum class CameraSource {
  kImages,  ///< the images come without a calibration
  kBag,     ///< a calibration comes with them
  kModel    ///< the calibration is that of the model: the height alone, and a camera's number
};
void add_camera_options(App& app, CameraArguments& arguments, CameraSource source);

/// --height and --height-sigma alone.
void add_height_options(App& app, CameraArguments& arguments);

}  // namespace camber::tools
