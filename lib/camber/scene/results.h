#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/stopwatch.h"
#include "camber/geometry/camera_sigma.h"
#include "camber/road/constraint.h"
#include "camber/road/road_surface.h"
#include "camber/scene/json_value.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// Vehicles of one frame, in that frame's camera.
struct VehicleFrame {
  int id = 0;  ///< frame id
  std::vector<VehicleEstimate> vehicles;
};

/// vehicles.json.
struct VehicleDocument {
  std::string method;       ///< "flat", "coplanar", "joint" or "reprojection"
  std::string preset;       ///< "default" or "paper"; empty: not of Camber's estimators
  std::string paper_terms;  ///< of preset "paper": "meant" or "printed"; otherwise empty
  int keypoint_set = 0;     ///< keypoints that were used, 36 or 14; 0: none
  std::string detections_source;
  bool metric = true;
  std::vector<VehicleFrame> frames;
};

/// run.json, as far as every command writes it.
struct RunDocument {
  std::uint64_t seed = 0;
  JsonValue options = JsonValue::object();
  Timings timings;
  struct CameraPose {
    int id = 0;
    SE3 reference_from_camera;
  };
  std::vector<CameraPose> cameras;
  bool metric = true;
  double scale = 1.0;        ///< metres per baseline of the motion
  double scale_sigma = 0.0;  ///< relative standard deviation
  /// What the camera's intrinsics leave open, where the scene does not take them for exact.
  struct Calibration {
    CameraSigma sigma;                 ///< as the scene states it
    double field_of_view = 0.0;        ///< rad, horizontal
    double field_of_view_sigma = 0.0;  ///< rad
    double sigma_of_scale = 0.0;       ///< the part of scale_sigma that the focal length makes
  };
  std::optional<Calibration> calibration;
  Status scale_status = Status::kNotRun;
  std::string scale_reason;
  std::string scene;  ///< absolute path of the scene, empty: from memory
  struct Warning {
    std::string code, text;
  };
  std::vector<Warning> warnings;
  std::vector<ConstraintReport> constraints;  ///< every source of road and scale, accepted or not
  std::vector<std::pair<std::string, long>> points_kept;     ///< "road": 12000, ...
  std::vector<std::pair<std::string, long>> points_dropped;  ///< reason: count
  std::string gl_backend;
  std::vector<std::pair<std::string, std::string>> input_hashes;  ///< path as given, hash
  JsonValue extra = JsonValue::object();  ///< further keys, merged at top level
};

/// JSON forms of the result files; numbers that are not finite become null.
nlohmann::json to_json(const PlanePatch& patch);
nlohmann::json to_json(const RoadSurface& surface);
nlohmann::json to_json(const VehicleDocument& document);
nlohmann::json to_json(const RunDocument& document);

/// Readers; @throws InputError "file: JSON path: found, expected".
RoadSurface read_surface(const std::filesystem::path& path);
VehicleDocument read_vehicles(const std::filesystem::path& path);
RunDocument read_run(const std::filesystem::path& path);

/// The folder that holds the road of a result (surface.json, road.ply, run.json with the cameras):
/// `surface` in the folder of a drive, else the folder itself.
std::filesystem::path road_folder(const std::filesystem::path& folder);

/// Writes JSON as format_json() gives it, atomically.
void write_json(const nlohmann::json& json, const std::filesystem::path& path);

}  // namespace camber
