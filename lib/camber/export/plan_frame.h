#pragma once

#include <Eigen/Core>

#include "camber/geometry/se3.h"

namespace camber {

/// The frame of exported files: x and y level, z up, right-handed, metres. Frames that are z-up
/// already stay as they are, map coordinates included; in others x is the part of the frame's z
/// axis (a camera's view) that lies across `up`, or of its x axis where that has none. Or the map
/// on which a result lies.
struct PlanFrame {
  Eigen::Matrix3d plan_from_surface = Eigen::Matrix3d::Identity();  ///< a rotation
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();                  ///< m, plan frame

  PlanFrame() = default;
  explicit PlanFrame(const Eigen::Vector3d& up);
  explicit PlanFrame(const SE3& map_from_surface)
      : plan_from_surface(map_from_surface.rotation_matrix()),
        shift(map_from_surface.translation()) {}
  Eigen::Vector3d to_plan(const Eigen::Vector3d& x) const { return turned(x) + shift; }
  Eigen::Vector3d to_surface(const Eigen::Vector3d& x) const {
    return plan_from_surface.transpose() * (x - shift);
  }
  /// A direction, in the plan frame.
  Eigen::Vector3d turned(const Eigen::Vector3d& direction) const {
    return plan_from_surface * direction;
  }
};

}  // namespace camber
