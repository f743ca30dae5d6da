#include "camber/export/trajectory.h"

#include <fmt/format.h>

namespace camber {
namespace {

std::string numbers(const SE3& pose, char between) {
  const Eigen::Vector3d t = pose.translation();
  Eigen::Quaterniond q = pose.rotation();
  if (q.w() < 0.0) q.coeffs() *= -1.0;  // one of two signs, always the same
  std::string out;
  for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
    out += between;
    out += fmt::format("{:.9f}", value);
  }
  return out;
}

}  // namespace

std::string encode_tum(const std::vector<StampedPose>& poses) {
  std::string out = "# timestamp tx ty tz qx qy qz qw\n";
  for (const StampedPose& pose : poses) {
    out += fmt::format("{:.6f}", pose.time_s) + numbers(pose.world_from_camera, ' ') + "\n";
  }
  return out;
}

std::string encode_kitti_poses(const std::vector<StampedPose>& poses) {
  std::string out;
  for (const StampedPose& pose : poses) {
    const Eigen::Matrix4d m = pose.world_from_camera.matrix();
    for (int i = 0; i < 12; ++i) {
      out += fmt::format("{:.9e}{}", m(i / 4, i % 4), i == 11 ? '\n' : ' ');
    }
  }
  return out;
}

std::string encode_pose_csv(const std::vector<StampedPose>& poses) {
  std::string out = "frame,time_s,x_m,y_m,z_m,qx,qy,qz,qw\n";
  for (const StampedPose& pose : poses) {
    out += fmt::format("{},{:.6f}", pose.id, pose.time_s) + numbers(pose.world_from_camera, ',');
    out += "\n";
  }
  return out;
}

}  // namespace camber
