#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/scale/ego_plane.h"

namespace camber::detail {

/// Axes at the camera: to the right, forward along the direction of travel, up. Unit vectors in the
/// camera frame.
struct TravelFrame {
  Eigen::Vector3d right, forward, up;
  Eigen::Vector3d of(const Eigen::Vector3d& p) const {
    return {right.dot(p), forward.dot(p), up.dot(p)};
  }
};

/// A path of constant curvature in plan that leaves the camera along its direction of travel.
struct CircularPath {
  double curvature = 0.0;  ///< positive: to the right
  /// A point of the travel frame as (to the right of the path, along it, up). What lies beyond a
  /// quarter of the circle is behind the camera.
  Eigen::Vector3d along(const Eigen::Vector3d& p) const;
  /// (right, forward) of the path's point that far along it.
  Eigen::Vector2d at(double distance) const;
};

/// What a profile is fitted to, along the driven path (CircularPath::along); lengths up to scale.
struct ProfileMeasurements {
  std::vector<Eigen::Vector3d> points;
  const RoadPoints* road = nullptr;   ///< spreads and shared parameters of the points
  std::vector<Eigen::Vector3d> path;  ///< the camera's other positions
  double level_cross_slope = 0.0;     ///< of a road on which the camera stands without roll
  double path_curvature = 0.0;        ///< of the driven path in plan, positive: to the right
};

/// Heights and cross slopes of the road along the driven path, m, at nodes `step` apart.
struct DrivenProfile {
  std::string failure;  ///< why there is none; empty: there is one
  int foot = 0;         ///< the node under the camera
  int nodes = 0;
  double step = 0.0;                 ///< m
  Eigen::VectorXd x;                 ///< heights of all nodes, then cross slopes
  Eigen::MatrixXd covariance;        ///< of x, without what the points share
  Eigen::MatrixXd shared;            ///< d(x) / d(shared parameters)
  double metres_per_baseline = 0.0;  ///< so that the camera is its height above the profile
  int points = 0;                    ///< of the strip that agree with it
  int compared = 0;                  ///< points of the strip

  double slope() const { return (x[foot + 1] - x[foot - 1]) / (2 * step); }  ///< at the foot
  double cross_slope() const { return x[nodes + foot]; }                     ///< at the foot
  /// Share of the strip's points that agree; 0: there is no profile.
  double agreeing() const {
    return failure.empty() && compared > 0 ? static_cast<double>(points) / compared : 0.0;
  }
  /// Of the camera over the tangent plane at the foot, m.
  double camera_height() const;
};

/// Robust least squares with a random walk of the vertical curvature and of the cross slope as
/// prior; the camera's path ties the road below it to itself.
/// @param metres_per_baseline  first guess of the scale
DrivenProfile fit_driven_profile(const ProfileMeasurements& measured, double metres_per_baseline,
                                 const EgoPlaneOptions& options);

}  // namespace camber::detail
