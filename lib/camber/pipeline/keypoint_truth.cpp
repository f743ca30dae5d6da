#include "camber/pipeline/keypoint_truth.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "camber/core/read_file.h"
#include "camber/core/threads.h"
#include "camber/image/undistortion.h"
#include "camber/image/video.h"
#include "camber/scene/json_reader.h"
#include "camber/vehicle/detail/keypoint_visibility.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Seen = std::array<bool, kNumKeypoints>;
/// By frame id and truth id.
using SeenByVehicle = std::map<std::pair<int, int>, Seen>;

/// keypoints_visible of a rendered scene's own truth; other keys are not read.
SeenByVehicle read_ray_casting(const fs::path& path) {
  SeenByVehicle out;
  JsonContext context{path.string(), {}};
  const nlohmann::json document = parse_json(read_whole_file(path), path.string());
  JsonObject root(JsonCursor(document, context));
  const char* whole = "a whole number of at least 0";
  for (const JsonCursor& frame_json : root.require("frames", "an array").items("an array")) {
    JsonObject frame(frame_json);
    const int id = frame.require("frame", whole).integer(0, 1 << 30, whole);
    for (const JsonCursor& car_json : frame.require("cars", "an array").items("an array")) {
      JsonObject car(car_json);
      const auto rows = car.find("keypoints_visible");
      if (!rows) continue;
      const int track = car.require("track_id", whole).integer(0, 1 << 30, whole);
      const std::vector<double> values = rows->numbers(kNumKeypoints, "36 numbers, 0 or 1");
      Seen& seen = out[{id, track}];
      for (std::size_t k = 0; k < seen.size(); ++k) seen[k] = values[k] != 0.0;
    }
  }
  return out;
}

bool judged(const TruthVehicle& vehicle, const KeypointTruthOptions& options) {
  return !vehicle.keypoints.empty() && vehicle.uncertain.empty() &&
         vehicle.box.height() >= options.least_height &&
         vehicle.occlusion <= options.most_occlusion &&
         vehicle.truncation <= options.most_truncation;
}

KeypointCropTruth crop_of(const PinholeCamera& camera, const Image& image,
                          const TruthVehicle& vehicle, const Seen* seen, int crop_size) {
  const Box2 box = vehicle.box.clipped(camera.width, camera.height);
  const KeypointCrop place = keypoint_crop(box);
  KeypointCropTruth out;
  out.crop = cut_crop(image, keypoint_crop(box, crop_size));
  out.box_side = std::max(box.width(), box.height()) / place.scale();
  out.box_height = box.height();
  const Eigen::Vector3d eye = vehicle.pose.camera_from_vehicle.inverse().translation();
  out.azimuth = std::atan2(-eye.x(), eye.z());
  for (std::size_t k = 0; k < kNumKeypoints; ++k) {
    const Eigen::Vector3d& point = vehicle.keypoints[k];
    const auto pixel = camera.project(point);
    out.points[k] = pixel ? place.to_crop(*pixel) : Eigen::Vector2d::Constant(-1e6);
    const Eigen::Vector3d in_vehicle = vehicle.pose.camera_from_vehicle.inverse() * point;
    const bool shown = seen ? (*seen)[k] : internal::shown_to(eye, static_cast<int>(k), in_vehicle);
    const Box2 whole{-0.5, -0.5, camera.width - 0.5, camera.height - 0.5};
    out.visibility[k] = !pixel || !whole.contains(*pixel) ? KeypointVisibility::kOutside
                        : shown                           ? KeypointVisibility::kVisible
                                                          : KeypointVisibility::kHiddenByCar;
  }
  return out;
}

}  // namespace

SceneKeypointTruth scene_keypoint_truth(const Scene& scene, const fs::path& folder,
                                        const KeypointTruthOptions& options, const LogSink& warn) {
  SceneKeypointTruth out;
  if (!scene.truth) return out;
  SeenByVehicle seen;
  const fs::path rays = folder / "truth/truth.json";
  std::error_code ignored;
  if (fs::exists(rays, ignored)) seen = read_ray_casting(rays);
  out.by_ray_casting = !seen.empty();
  const Undistortion lens(scene.camera, scene.distortion);
  FrameImageReader reader;
  for (const TruthFrame& frame : scene.truth->frames) {
    const SceneFrame* view = scene.find_frame(frame.id);
    std::vector<const TruthVehicle*> vehicles;
    for (const TruthVehicle& vehicle : frame.vehicles) {
      if (judged(vehicle, options)) vehicles.push_back(&vehicle);
    }
    if (!view || view->image.empty() || vehicles.empty()) continue;
    const Image image = reader.read(view->image, lens).color;
    const std::size_t first = out.crops.size();
    out.crops.resize(first + vehicles.size());
    parallel_for(vehicles.size(), options.num_threads, [&](std::size_t i) {
      const auto rows = seen.find({frame.id, vehicles[i]->id});
      out.crops[first + i] =
          crop_of(scene.camera, image, *vehicles[i], rows == seen.end() ? nullptr : &rows->second,
                  options.crop_size);
    });
  }
  if (warn && !out.crops.empty() && !out.by_ray_casting) {
    warn(folder.string() +
         ": what hides keypoints is not known: those on sides that a vehicle shows count as "
         "visible");
  }
  return out;
}

}  // namespace camber
