#include "camber/calibrate/write_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "camber/geometry/lens_map.h"
#include "camber/import/import_own.h"

namespace camber {
namespace {

constexpr double kDegrees = 57.29577951308232;

std::string matrix_yaml(const char* name, int rows, int columns, const std::string& data) {
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]\n",
                     name, rows, columns, data);
}

std::string angle_yaml(const char* name, const std::optional<MountingNumber>& angle) {
  if (!angle) return "";
  return fmt::format("{0}_deg: {1:.4f}\n{0}_deg_sigma: {2:.4f}\n", name, kDegrees * angle->value,
                     kDegrees * angle->sigma);
}

/// What a source measures of the focal length and of the height, each with the joint's value of the
/// other.
struct ReadSource {
  std::optional<MountingNumber> focal, height;  // px, m
};

ReadSource read_source(const CameraSource& source, const CameraJoint& joint) {
  const auto number = [&](double by, double by_other, double other) {
    const double value = std::exp((source.value - by_other * other) / by);
    return MountingNumber{value, value * source.sigma / std::abs(by), 0};
  };
  constexpr double kLeast = 0.05;  // a source that hardly depends on one does not measure it
  ReadSource out;
  if (std::abs(source.by_focal) > kLeast && std::abs(source.by_focal) >= source.by_height) {
    out.focal = number(source.by_focal, source.by_height, joint.value(1));
  }
  if (std::abs(source.by_height) > kLeast) {
    out.height = number(source.by_height, source.by_focal, joint.value(0));
  }
  return out;
}

std::string source_yaml(const CameraSource& source, const CameraJoint& joint) {
  const ReadSource read = read_source(source, joint);
  std::string out = fmt::format("#   {}:", source.phrase);
  if (read.focal) out += fmt::format(" {:.1f} +- {:.1f} px", read.focal->value, read.focal->sigma);
  if (read.focal && read.height) out += ", or";
  if (read.height) {
    out += fmt::format(" {:.3f} +- {:.3f} m", read.height->value, read.height->sigma);
  }
  return out + (source.accepted ? "" : "; left out, " + source.reason) + "\n";
}

nlohmann::json number_json(double value, double sigma) {
  return {{"value", value}, {"sigma", sigma}};
}

nlohmann::json optional_json(const std::optional<MountingNumber>& number) {
  if (!number) return nullptr;
  return number_json(number->value, number->sigma);
}

nlohmann::json source_json(const CameraSource& source, const CameraJoint& joint) {
  const ReadSource read = read_source(source, joint);
  nlohmann::json out = {
      {"name", source.name},
      {"source", source.phrase},
      {"by_log_focal", source.by_focal},
      {"by_log_height", source.by_height},
      {"value", source.value},
      {"sigma", source.sigma},
      {"common_sigma", source.common},
      {"focal", optional_json(read.focal)},
      {"height_m", optional_json(read.height)},
      {"residual_sigma",
       std::isfinite(source.residual_sigma) ? nlohmann::json(source.residual_sigma) : nullptr},
      {"accepted", source.accepted}};
  if (!source.accepted) out["reason"] = source.reason;
  return out;
}

nlohmann::json angle_json(const std::optional<MountingNumber>& angle) {
  if (!angle) return nullptr;
  return number_json(kDegrees * angle->value, kDegrees * angle->sigma);
}

/// Boxes and keypoints from the pixels of the scene's camera to those of its image files.
void put_lens_in(const PinholeCamera& camera, const LensDistortion& lens,
                 std::vector<SceneFrame>* frames) {
  const LensMap map(camera, lens);
  const auto carried = [&](double x, double y) {
    return map.raw_from_pinhole({x, y}).value_or(
        Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
  };
  for (SceneFrame& frame : *frames) {
    std::vector<VehicleDetection> kept;
    for (VehicleDetection& vehicle : frame.vehicles) {
      const Box2& b = vehicle.box;
      const double x = 0.5 * (b.x1 + b.x2), y = 0.5 * (b.y1 + b.y2);
      const Box2 box{carried(b.x1, y).x(), carried(x, b.y1).y(), carried(b.x2, y).x(),
                     carried(x, b.y2).y()};
      if (!(box.x1 < box.x2 && box.y1 < box.y2)) continue;
      vehicle.box = box;
      for (KeypointObservation& keypoint : vehicle.keypoints) {
        keypoint.pixel = carried(keypoint.pixel.x(), keypoint.pixel.y());
      }
      kept.push_back(std::move(vehicle));
    }
    frame.vehicles = std::move(kept);
  }
}

}  // namespace

std::string calibration_yaml(const DriveCalibration& c, const std::string& source) {
  const DriveLens& lens = c.lens.lens;
  std::string out = "%YAML:1.0\n---\n";
  out += fmt::format("# camber calibrate, of {}\n", source);
  out += fmt::format("image_width: {}\nimage_height: {}\n", lens.width, lens.height);
  out += matrix_yaml("camera_matrix", 3, 3,
                     fmt::format("{:.6f}, 0., {:.6f}, 0., {:.6f}, {:.6f}, 0., 0., 1.", lens.f,
                                 lens.cx, lens.f, lens.cy));
  out += matrix_yaml("distortion_coefficients", 1, 5,
                     fmt::format("{:.8f}, {:.8f}, 0., 0., 0.", lens.k1, lens.k2));
  out += fmt::format("# standard deviations: relative, pixels, of k1\n");
  out += fmt::format("focal_sigma: {:.6f}\nprincipal_sigma: {:.4f}\ndistortion_sigma: {:.6f}\n",
                     c.lens.sigma(0), std::max(c.lens.sigma(1), c.lens.sigma(2)), c.lens.sigma(3));
  out += fmt::format("# the focal length by {}\n", c.focal_decided_by);
  out += "# sources of focal length and height, each with the other as all of them give it\n";
  for (const CameraSource& one : c.sources) out += source_yaml(one, c.joint);
  out += angle_yaml("pitch", c.mounting.pitch);
  out += angle_yaml("yaw", c.mounting.yaw);
  out += angle_yaml("roll", c.mounting.roll);
  if (const auto& height = c.mounting.height) {
    out += fmt::format("# above the road, by {}\nheight_m: {:.4f}\nheight_m_sigma: {:.4f}\n",
                       c.mounting.height_by, height->value, height->sigma);
  }
  for (const std::string& note : c.notes) out += fmt::format("# {}\n", note);
  return out;
}

nlohmann::json to_json(const DriveCalibration& c) {
  const DriveLens& lens = c.lens.lens;
  nlohmann::json focal = number_json(lens.f, lens.f * c.lens.sigma(0));
  const auto& height = c.mounting.height;
  focal["relative_sigma"] = c.lens.sigma(0);
  focal["decided_by"] = c.focal_decided_by;
  nlohmann::json sources = nlohmann::json::array();
  for (const CameraSource& source : c.sources) sources.push_back(source_json(source, c.joint));
  return {{"frames", c.frames},
          {"key_frames", c.key_frames},
          {"windows", c.windows},
          {"turn_deg", kDegrees * c.turn},
          {"pixel_sigma_px", c.lens.pixel_sigma},
          {"inflation", c.lens.inflation},
          {"points", c.lens.points},
          {"camera",
           {{"width", lens.width},
            {"height", lens.height},
            {"focal", std::move(focal)},
            {"cx", number_json(lens.cx, c.lens.sigma(1))},
            {"cy", number_json(lens.cy, c.lens.sigma(2))},
            {"k1", number_json(lens.k1, c.lens.sigma(3))},
            {"k2", number_json(lens.k2, c.lens.sigma(4))}}},
          {"mounting",
           {{"pitch_deg", angle_json(c.mounting.pitch)},
            {"yaw_deg", angle_json(c.mounting.yaw)},
            {"roll_deg", angle_json(c.mounting.roll)},
            {"height_m", height ? number_json(height->value, height->sigma) : nullptr},
            {"height_by", height ? nlohmann::json(c.mounting.height_by) : nullptr}}},
          {"sources", std::move(sources)},
          {"prior",
           {{"focal", c.prior.mean.f},
            {"focal_sigma", c.prior.sigma(0)},
            {"principal_sigma", c.prior.sigma(1)},
            {"k1_sigma", c.prior.sigma(3)}}},
          {"notes", c.notes}};
}

Scene calibrated_scene(const Scene& scene, const DriveCalibration& c) {
  Scene out = scene;
  if (scene.distortion.model != LensModel::kNone) {
    put_lens_in(scene.camera, scene.distortion, &out.frames);
  }
  out.distortion = c.lens.lens.distortion();
  out.camera = c.lens.lens.pinhole();
  OwnImport report;
  take_out_lens(out, report);
  out.camera_sigma = {c.lens.sigma(0), std::max(c.lens.sigma(1), c.lens.sigma(2)), c.lens.sigma(3)};
  return out;
}

}  // namespace camber
