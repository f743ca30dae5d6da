#include "camber/export/plan_frame.h"

#include <Eigen/Geometry>

namespace camber {

PlanFrame::PlanFrame(const Eigen::Vector3d& up_given) {
  const Eigen::Vector3d up = up_given.normalized();
  if (up.isApprox(Eigen::Vector3d::UnitZ(), 1e-12)) return;
  Eigen::Vector3d ahead = Eigen::Vector3d::UnitZ() - up.z() * up;
  if (ahead.norm() < 0.1) ahead = Eigen::Vector3d::UnitX() - up.x() * up;
  ahead.normalize();
  plan_from_surface.row(0) = ahead.transpose();
  plan_from_surface.row(1) = up.cross(ahead).transpose();
  plan_from_surface.row(2) = up.transpose();
}

}  // namespace camber
