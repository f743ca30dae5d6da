#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// One detection matched to a counted true vehicle (DESIGN: greedy, box IoU at least 0.5).
struct VehicleError {
  int frame = 0, truth_id = 0, estimate_id = 0;
  double distance = 0.0;          ///< m, true bottom centre from the camera
  double center_error = 0.0;      ///< m, between true and estimated box centres
  /// m, signed: estimated minus true ground under the vehicle; against labels without a plane the
  /// difference along the camera's y at the label's bottom centre.
  double height_error = 0.0;
  double height_sigma = 0.0;      ///< m, stated
  double normal_error = 0.0;      ///< rad, NaN without a true plane
  double yaw_error = 0.0;         ///< rad, in [-pi, pi]
  Status status = Status::kNotRun;
};

struct SceneMetrics {
  std::vector<VehicleError> vehicles;
  int counted = 0;                ///< true vehicles that count
  int unanswered = 0;             ///< matched detections with status kFailed
  int missed = 0;                 ///< counted vehicles with no matching detection
  /// Relative to the true motion and scale, where truth has poses; NaN otherwise.
  double scale_error = 0.0;       ///< estimated / true path length - 1
  double rotation_error = 0.0;    ///< rad, largest over frames
  double direction_error = 0.0;   ///< rad, between the translations of first to last frame
  double ego_height_error = 0.0;  ///< m, ego plane at the foot under the camera, NaN without truth
  double ego_normal_error = 0.0;  ///< rad
};

/// Compares results with the truth of a scene (which must have one). Never used by an estimate.
SceneMetrics evaluate_scene(const Scene& scene, const RoadSurface& surface,
                            const VehicleDocument& vehicles, const RunDocument& run);

/// metrics.json.
nlohmann::json to_json(const SceneMetrics& metrics);

/// A few lines for a person: motion, scale, ego plane, height and position errors by distance.
std::string describe(const SceneMetrics& metrics);

}  // namespace camber
