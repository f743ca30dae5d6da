#include "camber/calibrate/guessed_camera.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/calibrate/write_calibration.h"
#include "camber/core/errors.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

constexpr double kDegrees = 57.29577951308232;
constexpr std::size_t kLeastWindows = 3;
/// Relative: a focal length that turns show so well gains nothing by what has known sizes.
constexpr double kLeaveSizes = 0.03;
/// Key frames of as many windows of three, of which each begins with the last of the one before.
constexpr std::size_t kLeastFrames = 2 * kLeastWindows + 1;

double field_of_view_deg(const DriveLens& lens) {
  return 2.0 * kDegrees * std::atan(0.5 * lens.width / lens.f);
}

/// By a relative standard deviation of the focal length.
double field_of_view_sigma_deg(const DriveLens& lens, double focal_sigma) {
  const double half = 0.5 * lens.width / lens.f;
  return kDegrees * 2.0 * half / (1.0 + half * half) * focal_sigma;
}

std::string guess_of(const LensPrior& prior) {
  return fmt::format("{:.0f} degrees, the focal length to {:.0f} %", field_of_view_deg(prior.mean),
                     100.0 * prior.sigma(0));
}

std::string stays(const LensPrior& prior, const std::string& why) {
  return fmt::format("the camera stays as it was guessed ({}): {}", guess_of(prior), why);
}

std::string used(const DriveCalibration& c) {
  const DriveLens& lens = c.lens.lens;
  std::string out = fmt::format(
      "the camera is calibrated by the drive: a field of view of {:.1f} +- {:.1f} degrees "
      "(guessed: "
      "{}), k1 {:.3f} +- {:.3f}, by {}",
      field_of_view_deg(lens), field_of_view_sigma_deg(lens, c.lens.sigma(0)), guess_of(c.prior),
      lens.k1, c.lens.sigma(3), c.focal_decided_by);
  for (const std::string& note : c.notes) out += "; " + note;
  return out;
}

}  // namespace

bool camera_is_guessed(const Scene& scene) {
  const CameraSigma& sigma = scene.camera_sigma;
  return scene.distortion.model == LensModel::kNone && sigma.principal == 0.0 &&
         sigma.distortion == 0.0 && sigma.focal > 2.0 * LensEstimateOptions{}.focal_floor;
}

LensPrior lens_prior_of(const Scene& scene) {
  const PinholeCamera& files = file_camera(scene);
  LensPrior out = lens_prior_of_cars(files.width, files.height);
  out.mean.f = std::sqrt(files.fx * files.fy);
  out.mean.cx = files.cx;
  out.mean.cy = files.cy;
  out.sigma(0) = scene.camera_sigma.focal;
  return out;
}

CameraByDrive calibrate_guessed(const Scene& scene, const std::vector<int>& frame_ids,
                                const CalibrateOptions& given, const FramePixelSource& pixels,
                                const Progress& progress) {
  CameraByDrive out;
  CalibrateOptions options = given;
  options.prior = lens_prior_of(scene);
  options.skip_unreadable = true;
  options.sizes_from = kLeaveSizes;
  if (frame_ids.size() < kLeastFrames) {
    out.text = stays(*options.prior, fmt::format("{} frames are too few to show it, at least {} do",
                                                 frame_ids.size(), kLeastFrames));
    return out;
  }
  Timings timings;
  try {
    const StageTimer timer(timings, "calibrate");
    out.calibration = calibrate_drive(scene, frame_ids, options, pixels, progress);
  } catch (const NoAnswerError& error) {
    out.text = stays(*options.prior, error.what());
  }
  out.milliseconds = timings.stages().front().second;
  if (!out.calibration) return out;
  const DriveCalibration& found = *out.calibration;
  constexpr double kClearly = 0.7;  // of the guess's standard deviation
  if (found.windows < kLeastWindows) {
    out.text = stays(found.prior, fmt::format("{} windows of key frames are too few to show it, at "
                                              "least {} do",
                                              found.windows, kLeastWindows));
  } else if (found.lens.sigma(0) > kClearly * found.prior.sigma(0)) {
    out.text = stays(found.prior, fmt::format("the drive, which turns by {:.0f} degrees over {} "
                                              "windows, leaves its focal length at {:.0f} %",
                                              kDegrees * found.turn, found.windows,
                                              100.0 * found.lens.sigma(0)));
  } else {
    out.text = used(found);
    out.scene = calibrated_scene(scene, found);
  }
  return out;
}

nlohmann::json to_json(const CameraByDrive& camera) {
  nlohmann::json out = {{"used", camera.scene.has_value()}, {"text", camera.text}};
  if (camera.calibration) out.update(to_json(*camera.calibration));
  return out;
}

}  // namespace camber
