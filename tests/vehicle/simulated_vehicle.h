#pragma once

#include <cstdint>

#include "camber/synth/car_family.h"
#include "camber/vehicle/annotated_shapes.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber::test {

struct SimulationOptions {
  std::uint64_t seed = 1;
  double min_distance = 7.0, max_distance = 45.0;  ///< m
  double keypoint_sigma_cells = 1.0;               ///< seen keypoints, of 64 cells
  double gross_share = 0.04;                       ///< seen keypoints that are anywhere
  double annotation_sigma = 0.05;                  ///< m, each axis, of a keypoint's own place
  double size_sigma = 0.05;                        ///< of each dimension, beyond the family's
  double box_sigma = 0.03;                         ///< of the box round the same car
  double occluded_share = 0.3;                     ///< vehicles of which a side is hidden
  bool confidences = true;                         ///< tell seen from guessed, mostly
  double plane_sigma_height = 0.03;                ///< m, error of the plane that is handed out
  double plane_sigma_tilt = 0.01;                  ///< rad
  /// Real cars in place of the family's: annotated shapes scaled to sizes of their own, so that the
  /// vehicles do not come from the model that explains them. Not owned.
  const std::vector<AnnotatedShape>* shapes = nullptr;
};

/// A car of the family on a road of any slope, seen by a KITTI-like camera, and what a detector
/// would say about it.
struct SimulatedVehicle {
  PinholeCamera camera;
  CarModel car;
  OrientedBox truth;
  std::array<Eigen::Vector3d, kNumKeypoints> keypoints;  ///< camera frame, m
  std::array<bool, kNumKeypoints> seen{};
  Plane true_plane;
  VehicleDetection detection;
  SupportPlane support;  ///< with an error drawn from its covariance
};

/// Depends on (options, index) alone.
SimulatedVehicle simulate_vehicle(const SimulationOptions& options, std::uint64_t index);

/// The same vehicle from another camera, `driven` metres on along its heading; on the same plane
/// with the same error. Depends on its arguments alone.
SimulatedVehicle seen_again(const SimulatedVehicle& vehicle, const SimulationOptions& options,
                            std::uint64_t index, int view, const SE3& camera_from_first,
                            double driven);

}  // namespace camber::test
