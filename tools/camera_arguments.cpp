#include "camera_arguments.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <optional>

namespace camber::tools {
namespace {

std::optional<double> positive(double value) {
  return value > 0.0 ? std::optional<double>(value) : std::nullopt;
}

constexpr double kLeastHeight = 0.05, kMostHeight = 20.0;  // m
constexpr double kLeastFov = 5.0, kMostFov = 179.0;        // degrees

/// Metres of a camera on a vehicle: whoever types more means centimetres, or another option.
Check height_of_camera() {
  Check out = in_range(kLeastHeight, kMostHeight);
  out.problem = [number = finite_number().problem](const std::string& text) {
    std::string wrong = number(text);
    if (!wrong.empty()) return wrong;
    const double value = std::stod(text);
    if (value >= kLeastHeight && value <= kMostHeight) return std::string();
    wrong = fmt::format("found {}, expected the camera's height above the road in metres, {} to {}",
                        text, kLeastHeight, kMostHeight);
    const double metres = 0.01 * value;
    const bool centimetres = metres >= 0.2 && metres <= kMostHeight;
    return centimetres ? wrong + fmt::format(": {} cm are {:.4g}", text, metres) : wrong;
  };
  return out;
}

/// Degrees of a camera whose images show a road.
Check field_of_view() {
  Check out = in_range(kLeastFov, kMostFov);
  out.problem = [number = finite_number().problem](const std::string& text) {
    std::string wrong = number(text);
    if (!wrong.empty()) return wrong;
    const double value = std::stod(text);
    if (value >= kLeastFov && value <= kMostFov) return std::string();
    wrong = fmt::format("found {}, expected a horizontal field of view in degrees, {} to {}", text,
                        kLeastFov, kMostFov);
    const double degrees = value * 57.29577951308232;
    const bool radians = degrees >= 20.0 && degrees <= 170.0;
    return radians ? wrong + fmt::format(": {} rad are {:.4g}", text, degrees) : wrong;
  };
  return out;
}

}  // namespace

void CameraArguments::take(OwnDataOptions* options) const {
  OwnCamera& camera = options->camera;
  camera.calibration = calibration;
  camera.name = name;
  camera.rectified = rectified;
  camera.fx = positive(fx);
  camera.fy = positive(fy);
  if (cx != kNone) camera.cx = cx;
  if (cy != kNone) camera.cy = cy;
  camera.fov_deg = positive(fov);
  camera.fov_sigma_deg = positive(fov_sigma);
  options->height = positive(height);
  options->height_sigma = positive(height_sigma);
}

void CameraArguments::add_json(nlohmann::json* options) const {
  const auto number = [](const std::optional<double>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json();
  };
  OwnDataOptions taken;
  take(&taken);
  options->update({{"calib", calibration},
                   {"camera", name},
                   {"rectified", rectified},
                   {"fx", number(taken.camera.fx)},
                   {"fy", number(taken.camera.fy)},
                   {"cx", number(taken.camera.cx)},
                   {"cy", number(taken.camera.cy)},
                   {"fov_deg", number(taken.camera.fov_deg)},
                   {"fov_sigma_deg", number(taken.camera.fov_sigma_deg)},
                   {"height", number(taken.height)},
                   {"height_sigma", number(taken.height_sigma)}});
}

void add_height_options(App& app, CameraArguments& a) {
  app.add_option(
         "--height,--camera-height", a.height,
         "of the camera above the road, m; without a source of metres results are up to scale")
      ->check(height_of_camera());
  app.add_option("--height-sigma", a.height_sigma,
                 fmt::format("standard deviation of the height, m; default: {}", kTypedHeightSigma))
      ->check(positive_number())
      ->needs("--height");
}

void add_camera_options(App& app, CameraArguments& a, CameraSource source) {
  if (source == CameraSource::kModel) {
    app.add_option("--camera", a.name, "id of the camera, where images have several")->no_name();
    return add_height_options(app, a);
  }
  const bool bag = source == CameraSource::kBag;
  app.add_option(
      "--calib", a.calibration,
      "calibration file: OpenCV, ROS, Kalibr, EuRoC, camodocal, ORB-SLAM, COLMAP, kapture, "
      "KITTI, nuScenes, OpenSfM, Metashape, nerfstudio, ZED, ...");
  app.add_option("--camera", a.name,
                 "name or index of the camera in that file, where it has several")
      ->no_name();
  auto* rectified =
      app.add_flag("--rectified", a.rectified,
                   bag ? "the images were rectified with the calibration's projection matrix"
                       : "the images were rectified with the file's projection matrix");
  if (!bag) rectified->needs("--calib");
  constexpr double kLeast = 1e-3, kMost = 1e7;  // px; a manifest takes no more
  app.add_option("--fx", a.fx, "focal length, pixels, in place of --calib")
      ->check(in_range(kLeast, kMost));
  app.add_option("--fy", a.fy, "likewise down the image; default: fx")
      ->check(in_range(kLeast, kMost));
  app.add_option("--cx", a.cx, "principal point, pixels; default: the middle")
      ->check(in_range(-kMost, kMost));
  app.add_option("--cy", a.cy, "likewise down the image")->check(in_range(-kMost, kMost));
  app.add_option("--fov", a.fov, "horizontal field of view, degrees, in place of --calib")
      ->check(field_of_view());
  app.add_option("--fov-sigma", a.fov_sigma,
                 fmt::format("standard deviation of --fov, degrees; default: {:g}", kFovSigmaDeg))
      ->check(positive_number())
      ->needs("--fov");
  add_height_options(app, a);
}

}  // namespace camber::tools
