#include "camber/export/result_vehicles.h"

#include <fmt/format.h>

#include <algorithm>

#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"
#include "camber/scene/vehicle_numbers.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// @param frame_from_vehicle  as VehiclePose has it: x to the front, y up, origin on the ground.
RoadsideVehicle placed(const SE3& frame_from_vehicle, const Dimensions& size,
                       const PlanFrame& frame) {
  RoadsideVehicle box;
  box.bottom = frame.to_plan(frame_from_vehicle.translation());
  const Eigen::Matrix3d axes = frame.plan_from_surface * frame_from_vehicle.rotation_matrix();
  box.set_axes(axes.col(0), axes.col(1));
  box.length = size.length;
  box.width = size.width;
  box.height = size.height;
  return box;
}

ResultVehicles of_reference_frame(const fs::path& folder, const PlanFrame& frame) {
  const RunDocument run = read_run(folder / "run.json");
  const VehicleDocument document = read_vehicles(folder / "vehicles.json");
  const VehicleNumbers numbers(document);
  ResultVehicles out;
  for (const VehicleFrame& seen : document.frames) {
    const bool reference = std::any_of(
        run.cameras.begin(), run.cameras.end(), [&](const RunDocument::CameraPose& camera) {
          return camera.id == seen.id && camera.reference_from_camera.matrix().isIdentity(1e-9);
        });
    if (!reference) continue;
    for (const VehicleEstimate& vehicle : seen.vehicles) {
      if (vehicle.status == Status::kFailed) continue;
      const SE3 pose(vehicle.pose.camera_from_vehicle.rotation(), vehicle.pose.bottom_center());
      RoadsideVehicle box = placed(pose, vehicle.pose.dimensions, frame);
      box.id = vehicle.id;
      box.name = vehicle_name(vehicle, numbers.of(seen.id, vehicle));
      out.vehicles.push_back(std::move(box));
    }
  }
  return out;
}

Dimensions dimensions_of(JsonObject object) {
  Dimensions out;
  out.length = object.require("length", "metres").positive();
  out.width = object.require("width", "metres").positive();
  out.height = object.require("height", "metres").positive();
  return out;
}

ResultVehicles of_tracks(const fs::path& file, const PlanFrame& frame) {
  const nlohmann::json document = parse_json(read_whole_file(file), file.string());
  JsonContext context{file.string(), {}};
  JsonObject all{JsonCursor(document, context)};
  ResultVehicles out;
  for (const JsonCursor& item : all.require("tracks", "a list of tracks").items("tracks")) {
    JsonObject track{item};
    if (track.require("motion", "parked or moving").text() != "parked") {
      ++out.moving;
      continue;
    }
    const std::vector<JsonCursor> views =
        track.require("views", "a list of views").items("views of the track");
    if (views.empty()) continue;
    // One place for all views.
    JsonObject view{views.back()};
    RoadsideVehicle box =
        placed(view.require("world_from_vehicle", "16 numbers").pose(),
               dimensions_of(JsonObject{track.require("dimensions", "an object")}), frame);
    box.id = track.require("id", "a number").integer(0, 1 << 30, "a number");
    box.name = fmt::format("{} {}", track.require("class", "a class").text(), box.id);
    out.vehicles.push_back(std::move(box));
  }
  return out;
}

}  // namespace

ResultVehicles result_vehicles(const fs::path& folder, const PlanFrame& frame) {
  std::error_code ignored;
  const fs::path tracks = folder / "tracks.json";
  return fs::exists(tracks, ignored) ? of_tracks(tracks, frame) : of_reference_frame(folder, frame);
}

}  // namespace camber
