#include "camber/pipeline/lift_map_box.h"

#include <Eigen/Geometry>
#include <cmath>

namespace camber {
namespace {

constexpr double kWeakSigma = 0.1;  // m
constexpr double kSteepest = 0.7;   // rad, of ground that a vehicle stands on
constexpr double kFarthest = 3.0;   // m, of a detector's bottom from the ground

}  // namespace

LiftedMapBox lift_map_box(const MapBox& box, const HeightSource& ground) {
  LiftedMapBox out;
  out.box = box;
  out.status = Status::kFailed;
  const Eigen::Vector3d up = box.rotation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d bottom = box.center - 0.5 * box.height * up;
  const GroundSample below = ground.at(bottom);
  if (!std::isfinite(below.height)) {
    out.reason = "no ground is known below";
    return out;
  }
  out.rise = below.height - bottom.z();
  out.height_sigma = below.sigma;
  if (std::abs(out.rise) > kFarthest) {
    out.reason = "the ground below is more than 3 m from the box";
    return out;
  }
  const Eigen::Vector3d normal = below.normal.normalized();
  if (!(normal.z() > std::cos(kSteepest))) {
    out.reason = "the ground below is too steep to stand on";
    return out;
  }
  // The heading in plan stays; the front is drawn onto the ground.
  Eigen::Vector3d front = box.rotation * Eigen::Vector3d::UnitX();
  front.z() = -(normal.x() * front.x() + normal.y() * front.y()) / normal.z();
  front.normalize();
  Eigen::Matrix3d axes;
  axes << front, normal.cross(front), normal;
  out.box.rotation = Eigen::Quaterniond(axes);
  if (out.box.rotation.w() < 0.0) out.box.rotation.coeffs() *= -1.0;
  const Eigen::Vector3d foot(bottom.x(), bottom.y(), below.height);
  out.box.center = foot + 0.5 * box.height * normal;
  const bool weak = !(below.sigma <= kWeakSigma);
  out.status = weak ? Status::kWeak : Status::kOk;
  if (weak) out.reason = "the ground below is known to no better than 0.1 m";
  return out;
}

}  // namespace camber
