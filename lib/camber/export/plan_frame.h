#pragma once

#include <Eigen/Core>

namespace camber {

/// The frame of exported files: x and y level, z up, right-handed, metres. Frames that are z-up
/// already stay as they are, map coordinates included; in others x is the part of the frame's z
/// axis (a camera's view) that lies across `up`, or of its x axis where that has none.
struct PlanFrame {
  Eigen::Matrix3d plan_from_surface = Eigen::Matrix3d::Identity();  ///< a rotation

  PlanFrame() = default;
  explicit PlanFrame(const Eigen::Vector3d& up);
  Eigen::Vector3d to_plan(const Eigen::Vector3d& x) const { return plan_from_surface * x; }
  Eigen::Vector3d to_surface(const Eigen::Vector3d& x) const {
    return plan_from_surface.transpose() * x;
  }
};

}  // namespace camber
