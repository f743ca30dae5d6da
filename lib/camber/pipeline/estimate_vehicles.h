#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/joint_fit.h"
#include "camber/vehicle/support_plane.h"

namespace camber {

struct EstimateVehiclesOptions {
  /// "joint": each detection's own given plane, else the frame's ego plane, else a level plane at
  /// the camera's height; "coplanar": the frame's ego plane (else the level one) for all, taken for
  /// certain; "flat": the level plane for all, taken for certain.
  std::string method = "joint";
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
  VehicleFitOptions fit;
  /// Also solves all vehicles and planes of a frame in one problem, from the single fits.
  bool one_problem = false;
  JointFitOptions joint;  ///< of that problem
  /// Joins the views of a vehicle where the frames' poses are known (method "joint" alone): one
  /// shape for all, parked or moving.
  bool tracks = true;
  /// The road of a run, in place of the scene's planes, and its cameras, in place of the scene's
  /// poses; not owned, both or neither.
  const RoadSurface* surface = nullptr;
  const std::vector<RunDocument::CameraPose>* cameras = nullptr;
  SupportOptions support;
  void validate() const;  ///< throws std::invalid_argument
};

/// Vehicles alone, from a scene's detections, keypoints and planes; images and truth are not read.
/// Without a camera height in the scene a height of 1.65 m with a wide prior is taken, and the
/// document says that it is not metric.
/// With a run's surface every vehicle stands on the patch that its box's bottom meets; a frame that
/// the run did not see keeps the scene's planes. Planes that hold the word of the run's vehicles are
/// taken without it: the vehicles are about to tell it again.
/// @param frame_ids  ids of the scene; @throws std::invalid_argument for another id.
VehicleDocument estimate_vehicles(const Scene& scene, const std::vector<int>& frame_ids,
                                  const EstimateVehiclesOptions& options,
                                  const Progress& progress = {});

}  // namespace camber
