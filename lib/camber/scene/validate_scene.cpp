#include "camber/scene/validate_scene.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "camber/scene/camera_up.h"
#include "camber/scene/marking_presets.h"

namespace camber {
namespace {

/// What is refused: the field's name, the value found and what is expected.
template <typename Value>
[[noreturn]] void refuse(const std::string& field, const Value& found, const char* expected) {
  throw std::invalid_argument(fmt::format("{}: found {}, expected {}", field, found, expected));
}

void require_positive(double value, const char* field, const char* unit) {
  if (value > 0.0 && std::isfinite(value)) return;
  refuse(field, value, fmt::format("a positive number of {}", unit).c_str());
}

void check_plane(const Plane& plane, const std::string& field) {
  const bool unit = std::abs(plane.normal.norm() - 1.0) < 1e-3;  // as the reader has it
  if (!unit) refuse(field + ".normal", plane.normal.norm(), "length 1");
  if (!(plane.normal.y() < 0.0)) refuse(field + ".normal", plane.normal.y(), "y < 0: up");
  if (!std::isfinite(plane.offset)) refuse(field + ".offset", plane.offset, "a number of metres");
}

void check_up(const Eigen::Vector3d& up) {
  const double length = up.norm();
  if (!(length > 0.0) || !std::isfinite(length)) refuse("up (its length)", length, "a direction");
  if (const char* wrong = why_not_up(up / length)) {
    throw std::invalid_argument(fmt::format(
        "up points {}, expected a direction away from the ground in the camera frame", wrong));
  }
}

void check_detection(const VehicleDetection& vehicle) {
  const std::string of = fmt::format("vehicle {}: ", vehicle.id);
  if (vehicle.id < 0) refuse("vehicle id", vehicle.id, "at least 0");
  if (vehicle.track < -1) refuse(of + "track", vehicle.track, "at least -1");
  if (!std::isfinite(vehicle.score)) refuse(of + "score", vehicle.score, "a number");
  const Box2& box = vehicle.box;
  if (!(box.x1 <= box.x2 && box.y1 <= box.y2 && std::isfinite(box.area()))) {
    refuse(of + "box", fmt::format("{}, {} to {}, {}", box.x1, box.y1, box.x2, box.y2),
           "x1 <= x2, y1 <= y2");
  }
  const std::size_t rows = vehicle.keypoints.size();
  if (rows != 0 && rows != kNumKeypoints) refuse(of + "keypoints", rows, "36 rows or none");
  for (const KeypointObservation& k : vehicle.keypoints) {
    // NaN is one that is not seen.
    if (k.pixel.array().isInf().any()) {
      refuse(of + "keypoints", fmt::format("{}, {}", k.pixel.x(), k.pixel.y()), "pixels");
    }
    if (k.sigma <= 0.0) refuse(of + "keypoints (sigma)", k.sigma, "a positive number of pixels");
  }
  if (vehicle.has_plane) check_plane(vehicle.given_plane, of + "plane");
}

void check_classes(const std::map<std::string, std::vector<int>>& classes) {
  std::map<int, std::string> owner;
  for (const auto& [name, labels] : classes) {
    for (const int label : labels) {
      if (label < 0 || label > 255) {
        refuse("segmentation_classes", label, "label values from 0 to 255");
      }
      const auto [at, fresh] = owner.emplace(label, name);
      if (!fresh && at->second != name) {
        refuse("segmentation_classes",
               fmt::format("{} under \"{}\" and \"{}\"", label, at->second, name),
               "each label value under one class");
      }
    }
  }
}

void check_markings(const std::map<std::string, double>& sizes) {
  const std::vector<std::string>& names = marking_size_names();
  for (const auto& [name, size] : sizes) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      refuse("markings_m", "\"" + name + "\"", fmt::format("{}", fmt::join(names, ", ")).c_str());
    }
    require_positive(size, ("markings_m: " + name).c_str(), "metres");
  }
}

}  // namespace

void validate(const SceneFrame& frame) {
  if (frame.id < 0) refuse("id", frame.id, "at least 0");
  if (frame.time_s && !std::isfinite(*frame.time_s))
    refuse("time_s", *frame.time_s, "a number of seconds");
  if (frame.ego_plane) check_plane(*frame.ego_plane, "ego_plane");
  if (frame.world_from_camera && !frame.world_from_camera->matrix().allFinite()) {
    throw std::invalid_argument("world_from_camera is not finite");
  }
  if (frame.up) {
    check_up(*frame.up);
    require_positive(frame.up_sigma, "up_sigma", "radians");
  }
  if (frame.speed) {
    if (!(*frame.speed >= 0.0) || !std::isfinite(*frame.speed))
      refuse("speed", *frame.speed, ">= 0 m/s");
    require_positive(frame.speed_sigma, "speed_sigma", "m/s");
  }
  std::set<int> ids;
  for (const VehicleDetection& vehicle : frame.vehicles) {
    check_detection(vehicle);
    if (!ids.insert(vehicle.id).second) {
      throw std::invalid_argument(fmt::format(
          "vehicle id: found {} a second time, expected ids that differ within the frame",
          vehicle.id));
    }
  }
}

void validate_camera_height(double height) {
  if (height > 0.0 && height <= kMostCameraHeight) return;
  refuse("height_above_road", height, "a positive number of metres up to 1000");
}

void validate(const Scene& scene) {
  scene.camera.validate();
  if (scene.distortion.model != LensModel::kNone || !scene.distortion.coefficients.empty()) {
    scene.distortion.validate();
  }
  if (scene.height_above_road) validate_camera_height(*scene.height_above_road);
  require_positive(scene.height_sigma, "height_sigma", "metres");
  for (const auto& [field, sigma] :
       {std::pair{"camera_sigma.focal", scene.camera_sigma.focal},
        std::pair{"camera_sigma.principal", scene.camera_sigma.principal},
        std::pair{"camera_sigma.distortion", scene.camera_sigma.distortion}}) {
    if (!(sigma >= 0.0) || !std::isfinite(sigma)) refuse(field, sigma, "a number of at least 0");
  }
  if (scene.frame_rate) require_positive(*scene.frame_rate, "frame_rate", "frames a second");
  if (scene.box_sigma_px) require_positive(*scene.box_sigma_px, "box_sigma_px", "pixels");
  check_classes(scene.segmentation_classes);
  check_markings(scene.markings_m);
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    try {
      validate(scene.frames[i]);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(fmt::format("frame {}: {}", scene.frames[i].id, error.what()));
    }
    if (i > 0 && scene.frames[i].id <= scene.frames[i - 1].id) {
      refuse("frames", fmt::format("{} behind {}", scene.frames[i].id, scene.frames[i - 1].id),
             "ids in ascending order");
    }
  }
  if (scene.reference_frame && !scene.frames.empty() && !scene.find_frame(*scene.reference_frame)) {
    refuse("reference_frame", *scene.reference_frame, "the id of one of the frames");
  }
}

}  // namespace camber
