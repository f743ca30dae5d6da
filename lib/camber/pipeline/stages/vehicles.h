#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/surface.h"
#include "camber/road/local_plane.h"
#include "camber/road/plane_graph.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/scale_noise.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/focal_length.h"
#include "camber/vehicle/support_plane.h"
#include "camber/vehicle/vehicle_tracks.h"

namespace camber {

/// The plane on which vehicles are placed.
enum class VehicleMethod {
  kJoint,     ///< each on its own local plane, with its covariance
  kCoplanar,  ///< all on the ego plane, taken for certain (the paper's ablation)
  kFlat,      ///< all on a level plane at the camera's height, taken for certain (Murthy et al.)
  kReprojection,  ///< on no plane: keypoints, boxes and the prior alone, image by image
};
std::string to_string(VehicleMethod method);  ///< "joint", "coplanar", "flat", "reprojection"
/// Inverse of to_string. @throws std::invalid_argument for another word.
VehicleMethod vehicle_method_from_string(const std::string& word);

/// The ground of one frame as it is known before its vehicles are placed; frame's own camera, m.
struct FrameGround {
  std::optional<SupportPlane> ego;
  std::vector<std::optional<SupportPlane>> local;  ///< one a detection; nothing: not known there
};

/// What a track measures of the road, and where: see TrackMessage.
struct VehicleConstraint {
  Constraint constraint;         ///< "vehicle", around the road's mean
  std::vector<TrackView> views;  ///< of the vehicle
  Eigen::MatrixXd by_ground;     ///< rows as the constraint's, columns as SharedGround::covariance
  Eigen::VectorXd variance;      ///< of each row, without the ground's unevenness
};

/// The consistency graph of a run's planes before its vehicles: the ego plane, the patches along
/// the road, then the planes under the detections.
struct GroundGraph {
  PlaneGraph planes;
  std::vector<int> ids;           ///< patch of each node; -1: none
  SharedGround under_detections;  ///< of the last nodes and the scale
};

/// Vehicles on their planes.
struct PlacedVehicles {
  std::vector<TrackFrame> views;  ///< with the planes on which they were placed
  std::vector<std::vector<VehicleEstimate>> estimates;  ///< [frame][detection]
  std::vector<std::vector<int>> tracks;                 ///< [frame][detection]; -1: none
  std::vector<TrackMessage> messages;                   ///< of the tracks, with a joint ground
  std::vector<VehicleConstraint> constraints;           ///< of a run's road, by those messages
  GroundGraph ground;                                   ///< before the vehicles
  /// Of the reference frame's vehicles; asked for that of ScaledRoad::dash_focal_length.
  FocalLengthEvidence focal_length;
};

namespace stages {

struct VehicleOptions {
  VehicleMethod method = VehicleMethod::kJoint;
  VehicleFitOptions fit;
  SupportOptions support;
  ScaleNoise noise;     ///< of a camera height that is not known
  bool enabled = true;  ///< false: no vehicle is placed (reconstruct)
  /// Joins the views of a vehicle (method joint): one shape for all, parked or moving.
  bool tracks = true;
  /// Messages between vehicles pass over the consistency graph; false: by the joint covariance of
  /// all planes, whose time and memory grow with its square (benchmarks).
  bool graph = true;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
};

/// The planes under a frame's detections by the method: the ground found there, else the one given
/// with a detection, else the ego plane, else a level one at the camera's height.
/// @param camera_height  m; nothing: a usual one, known badly.
std::vector<SupportPlane> choose_supports(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const FrameGround& ground,
                                          std::optional<double> camera_height,
                                          const VehicleOptions& options);

/// Places the vehicles of frames on their supports.
/// @param views   without estimates, which are found here.
/// @param ground  joint covariance of the supports; not owned, or null.
PlacedVehicles place_vehicles(const PinholeCamera& camera, std::vector<TrackFrame> views,
                              const SharedGround* ground, double scale_sigma,
                              const VehicleOptions& options);

/// Places the vehicles of a run on its road, and what they measure of it.
PlacedVehicles vehicles(const LoadedFrames& frames, const MotionEstimate& motion,
                        const ScaledRoad& road, const SurfacePlan& plan,
                        const VehicleOptions& options);

}  // namespace stages
}  // namespace camber
