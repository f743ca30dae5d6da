#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/geometry/se3.h"

namespace camber::internal {

/// A view of a vehicle that moves.
struct MovingView {
  double time_s = 0.0;
  SE3 world_from_camera;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();  ///< m, of the vehicle in the camera
  bool measured = true;                             ///< false: the place says nothing
  double direction_sigma = 0.0;                     ///< slope
  double range_sigma = 0.0;                         ///< relative
};

struct MovingPathNoise {
  /// m^2/s^3: 0.7 m/s^2 that lasts for 2 s, as the camera's own speed has it (TrajectoryNoise).
  double acceleration_density = 2.0;
  double alike = 5.0;  ///< views that follow each other and share their errors
};

/// A place of it in the world.
struct MovingPlace {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();    ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< without what all views share
};

/// The smooth path of a vehicle by the directions and distances of its views, with heavy tails: its
/// velocity is a random walk. One place a view, of those that measure nothing, too.
/// @param views  by time.
/// @return nothing with fewer than three measured views, or times that do not ascend.
std::optional<std::vector<MovingPlace>> moving_path(const std::vector<MovingView>& views,
                                                    const MovingPathNoise& noise = {});

}  // namespace camber::internal
