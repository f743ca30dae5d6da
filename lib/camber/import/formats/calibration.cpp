#include "camber/import/formats/calibration.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/calibration_forms.h"
#include "camber/import/import_common.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{64} << 20;
constexpr double kMaxIntrinsic = 1e7;  // pixels
constexpr int kMaxSide = 65535;

bool all_zero(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return v == 0.0; });
}

/// What every form must hold: numbers that a camera can have.
void check(const CameraCalibration& camera, const std::string& file) {
  const std::string name = camera.name.empty() ? "camera" : "camera " + printable(camera.name);
  const auto refuse = [&](const char* what, double value, const char* expected) {
    throw InputError(file, name, fmt::format("found {} = {}, expected {}", what, value, expected));
  };
  const auto focal = [&](const char* what, double value) {
    if (!(value > 0.0 && value <= kMaxIntrinsic))
      refuse(what, value, "a positive number of pixels");
  };
  const bool known = camera.unsupported.empty();
  if (known) focal("fx", camera.fx);
  if (known) focal("fy", camera.fy);
  for (const auto& [what, value] : {std::pair("cx", camera.cx), std::pair("cy", camera.cy)}) {
    if (!(std::abs(value) <= kMaxIntrinsic)) refuse(what, value, "a number of pixels");
  }
  for (const auto& [what, value] :
       {std::pair("width", camera.width), std::pair("height", camera.height)}) {
    if (value && (*value < 1 || *value > kMaxSide)) refuse(what, *value, "from 1 to 65535 pixels");
  }
}

}  // namespace

void set_opencv_lens(CameraCalibration* camera, std::vector<double> coefficients) {
  camera->lens_coefficients.clear();
  camera->lens = LensModel::kNone;
  const std::size_t given = coefficients.size();
  if (given == 1) coefficients.push_back(0.0);
  if (coefficients.size() == 2) coefficients.resize(4, 0.0);
  if (given == 3 || given > 14) {
    camera->unsupported =
        fmt::format("it has {} distortion coefficients, expected 4, 5 or 8 of OpenCV's", given);
    return;
  }
  if (coefficients.size() > 8) {
    if (!all_zero({coefficients.begin() + 8, coefficients.end()})) {
      camera->unsupported = "its thin prism or tilted sensor terms are not supported";
      return;
    }
    coefficients.resize(8);
  }
  if (all_zero(coefficients)) return;
  if (coefficients.size() > 5) {
    coefficients.resize(8, 0.0);
    if (all_zero({coefficients.begin() + 5, coefficients.end()})) coefficients.resize(5);
  }
  camera->lens = LensModel::kBrown;
  camera->lens_coefficients = std::move(coefficients);
}

void set_fisheye_lens(CameraCalibration* camera, std::vector<double> coefficients) {
  if (coefficients.size() > 4) {
    if (!all_zero({coefficients.begin() + 4, coefficients.end()})) {
      camera->unsupported = fmt::format(
          "it has {} coefficients of the equidistant model, expected 4", coefficients.size());
      return;
    }
  }
  coefficients.resize(4, 0.0);
  camera->lens = LensModel::kFisheye;
  camera->lens_coefficients = std::move(coefficients);
}

void set_lens_by_word(CameraCalibration* camera, const std::string& word,
                      const std::vector<double>& coefficients) {
  static const std::set<std::string> brown = {"",
                                              "opencv",
                                              "pinhole",
                                              "plumbbob",
                                              "radtan",
                                              "brown",
                                              "brownconrady",
                                              "radialtangential",
                                              "rationalpolynomial",
                                              "rational",
                                              "standard",
                                              "perspective",
                                              "pinholeradtan",
                                              "pinholeradtan8",
                                              "radtan8",
                                              "normal",
                                              "pinholeradialtangential",
                                              "radialtangential8",
                                              "distortedpinhole"};
  static const std::set<std::string> fisheye = {
      "equidistant",    "equi",          "fisheye", "kannalabrandt", "kannalabrandt4",
      "kannalabrandt8", "kb4",           "kb8",     "opencvfisheye", "pinholeequidistant",
      "pinholeequi",    "pinholefisheye"};
  static const std::set<std::string> none = {"none", "pinholenone", "nodistortion", "rectified",
                                             "undistorted"};
  const std::string plain = plain_name(word);
  if (none.count(plain)) {
    if (!all_zero(coefficients)) {
      camera->unsupported =
          "its model is \"" + printable(word) + "\" but it has distortion coefficients";
    }
  } else if (brown.count(plain)) {
    set_opencv_lens(camera, coefficients);
  } else if (fisheye.count(plain)) {
    set_fisheye_lens(camera, coefficients);
  } else {
    camera->unsupported = "its camera model \"" + printable(word) + "\" is not supported";
  }
}

void set_skew(CameraCalibration* camera, double skew) {
  constexpr double kLargest = 2.0;  // pixels where y is 1, 45 degrees off the axis
  if (skew == 0.0 || std::abs(skew) <= 1e-6 * std::abs(camera->fx)) return;
  if (std::abs(skew) > std::max(kLargest, 1e-3 * std::abs(camera->fx))) {
    camera->unsupported = fmt::format("its pixels are skewed by {}", skew);
    return;
  }
  camera->note = fmt::format("its skew of {:.2g} pixels is left out", skew);
}

CalibrationFile read_calibration(const fs::path& path) {
  const std::string text = read_whole_file(path, kMaxBytes);
  const std::size_t first = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  const bool xml = first != std::string::npos && text[first] == '<';
  std::optional<CalibrationFile> out;
  if (xml && text.find("<opencv_storage") == std::string::npos)
    out = calibration_of_xml(text, path);
  if (!out) out = calibration_of_text(path, text);
  if (!out) out = calibration_of_document(Document::parse(text, path.string()));
  if (!out) {
    throw InputError(path.string(),
                     "found no camera, expected a calibration of OpenCV, ROS, Kalibr, EuRoC, "
                     "camodocal, ORB-SLAM, Basalt, COLMAP, kapture, KITTI, nuScenes, OpenSfM, "
                     "Metashape, nerfstudio, ZED, OKVIS, rpg_vikit or Argoverse");
  }
  for (const CameraCalibration& camera : out->cameras) check(camera, path.string());
  return *out;
}

const CameraCalibration& choose_camera(const CalibrationFile& file, const std::string& choice,
                                       const fs::path& path, int width, int height) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < file.cameras.size() && i < 12; ++i) {
    const std::string& name = file.cameras[i].name;
    names.push_back(name.empty() ? std::to_string(i) : printable(name, 64));
  }
  if (file.cameras.size() > names.size()) names.emplace_back("...");
  const std::string listed = fmt::format("{}", fmt::join(names, ", "));
  if (file.cameras.empty()) throw InputError(path.string(), "found no camera, expected one");
  if (choice.empty()) {
    if (file.cameras.size() == 1) return file.cameras.front();
    std::vector<const CameraCalibration*> fitting;
    for (const CameraCalibration& camera : file.cameras) {
      if (camera.width == width && camera.height == height) fitting.push_back(&camera);
    }
    const bool zed =
        file.form == "ZED" && fitting.size() == 2 && fitting[0]->name.rfind("LEFT", 0) == 0;
    if (fitting.size() == 1 || zed) return *fitting.front();
    throw InputError(path.string(),
                     fmt::format("found {} cameras ({}), expected --camera to name one",
                                 file.cameras.size(), listed));
  }
  const CameraCalibration* found = nullptr;
  for (const CameraCalibration& camera : file.cameras) {
    if (camera.name == choice) return camera;
    if (lower_case(camera.name) == lower_case(choice)) found = &camera;
  }
  if (found) return *found;
  const bool digits = std::all_of(choice.begin(), choice.end(),
                                  [](unsigned char c) { return c >= '0' && c <= '9'; });
  if (digits && choice.size() < 6) {
    const auto index = static_cast<std::size_t>(std::stoi(choice));
    if (index < file.cameras.size()) return file.cameras[index];
  }
  throw InputError(path.string(), fmt::format("found no camera {}, expected one of {}",
                                              printable(choice), listed));
}

LensDistortion lens_of(const CameraCalibration& camera, bool rectified, int width, int height,
                       const fs::path& path) {
  if ((camera.width && *camera.width != width) || (camera.height && *camera.height != height)) {
    throw InputError(
        path.string(),
        fmt::format("found a camera of {} x {} pixels, expected the images' {} x {}",
                    camera.width.value_or(width), camera.height.value_or(height), width, height));
  }
  LensDistortion out;
  const double shift = camera.first_pixel;
  if (rectified) {
    if (camera.projection.empty()) {
      throw InputError(path.string(),
                       "found no projection matrix, expected one for images that are rectified");
    }
    const std::vector<double>& p = camera.projection;
    if (!(p[0] > 0.0 && p[5] > 0.0)) {
      throw InputError(
          path.string(),
          fmt::format("found focal lengths {} and {} in the projection matrix, expected "
                      "positive ones",
                      p[0], p[5]));
    }
    out.raw = {width, height, p[0], p[5], p[2] - shift, p[6] - shift};
    return out;
  }
  if (!camera.unsupported.empty()) {
    throw InputError(
        path.string(),
        fmt::format("found the camera {}: {}; expected a pinhole camera without or with "
                    "OpenCV's distortion or fisheye model",
                    camera.name.empty() ? camera.model : printable(camera.name),
                    camera.unsupported));
  }
  out.model = camera.lens;
  out.coefficients = camera.lens_coefficients;
  out.raw = {width, height, camera.fx, camera.fy, camera.cx - shift, camera.cy - shift};
  try {
    out.validate();
  } catch (const std::invalid_argument& error) {
    throw InputError(path.string(), fmt::format("found a camera that cannot be used: {}; expected "
                                                "numbers of a lens",
                                                error.what()));
  }
  return out;
}

}  // namespace camber
