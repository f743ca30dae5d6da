#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// One detection matched to a counted true vehicle (DESIGN: greedy, box IoU at least 0.5).
struct VehicleError {
  int frame = 0, truth_id = 0, estimate_id = 0;
  double distance = 0.0;      ///< m, true bottom centre from the camera
  double center_error = 0.0;  ///< m, between true and estimated box centres
  /// m, signed: estimated minus true ground under the vehicle; against labels without a plane the
  /// difference along the camera's y at the label's bottom centre. NaN where no plane is stated.
  double height_error = 0.0;
  double height_sigma = 0.0;  ///< m, stated
  double normal_error = 0.0;  ///< rad, NaN without a true plane
  double yaw_error = 0.0;     ///< rad, in [-pi, pi]
  double along_error = 0.0;   ///< m, centre error along the viewing ray, positive: too far
  /// Squared, by the stated covariance; 3 degrees of freedom. NaN where none is stated; infinite
  /// where the centre errs in a direction that is stated as certain.
  double center_mahalanobis = 0.0;
  bool singular_covariance = false;  ///< stated, but with a direction (or all) without variance
  double keypoint_error = 0.0;       ///< m, mean distance of the 36 keypoints; NaN without truth
  double dimension_error = 0.0;      ///< m, mean absolute error of length, width and height
  double true_depth = 0.0;           ///< m, of the true box centre along the camera's z
  double depth = 0.0;                ///< m, estimated; NaN where not answered
  double depth_sigma = 0.0;          ///< m, stated; NaN where not known
  double overlap = 0.0;              ///< IoU of the boxes
  bool answered = false;             ///< status is not kFailed
  Status status = Status::kNotRun;
};

struct SceneMetrics {
  std::vector<VehicleError> vehicles;
  int counted = 0;              ///< true vehicles that count
  int unjudged = 0;             ///< true vehicles that would, in frames that the results lack
  int uncertain = 0;            ///< true vehicles that do not, since their truth is uncertain
  int unanswered = 0;           ///< matched detections with status kFailed
  int missed = 0;               ///< counted vehicles with no matching detection
  int without_covariance = 0;   ///< answered ones that state no covariance of their centre
  int singular_covariance = 0;  ///< answered ones with one that is not positive definite
  int within_40 = 0;            ///< counted vehicles at most 40 m away, in frames with a pose
  int covered_within_40 = 0;    ///< of these, those below which the surface gives an answer
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

/// Whether a true vehicle counts (DESIGN, "How results are judged"): occlusion at most 0.7,
/// truncation at most 0.5, true box at least 14 px high (9 px in images of 960 columns); and its
/// truth is not uncertain.
bool is_counted(const TruthVehicle& vehicle, const PinholeCamera& camera);

/// One detection that is judged against one counted true vehicle.
struct Match {
  std::size_t truth = 0, estimate = 0;  ///< indices into the two lists
  double overlap = 0.0;                 ///< IoU
};

/// Greedy matching by IoU, best first, at least 0.5, of counted true vehicles (boxes clipped to the
/// image) with detections. Ties keep the order of the lists.
std::vector<Match> match_vehicles(const std::vector<TruthVehicle>& truth,
                                  const std::vector<VehicleEstimate>& estimates,
                                  const PinholeCamera& camera);

/// Errors of one matched vehicle; frame and estimate in the camera of that frame.
VehicleError compare_vehicle(const TruthVehicle& truth, const VehicleEstimate& estimate);

/// Errors of the vehicles alone, frame by frame; motion and surface stay NaN.
/// @throws std::invalid_argument if the scene has no truth.
SceneMetrics evaluate_vehicles(const Scene& scene, const VehicleDocument& vehicles);

/// A few lines for a person: motion, scale, ego plane, height and position errors by distance.
std::string describe(const SceneMetrics& metrics);

}  // namespace camber
