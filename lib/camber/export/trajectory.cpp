#include "camber/export/trajectory.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <cmath>
#include <ctime>

#include "camber/core/version.h"

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

std::string encode_gpx(const std::vector<GeoPoint>& points) {
  std::string out = fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<gpx version=\"1.1\" creator=\"Camber {}\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n"
      "  <trk>\n    <trkseg>\n",
      kVersion);
  for (const GeoPoint& point : points) {
    out +=
        fmt::format("      <trkpt lat=\"{:.9f}\" lon=\"{:.9f}\">", point.latitude, point.longitude);
    if (std::isfinite(point.altitude)) out += fmt::format("<ele>{:.4f}</ele>", point.altitude);
    if (std::isfinite(point.time_s)) {
      const auto milliseconds = static_cast<long long>(std::llround(point.time_s * 1000.0));
      const auto seconds = static_cast<std::time_t>(milliseconds / 1000);
      out += fmt::format("<time>{:%Y-%m-%dT%H:%M:%S}.{:03}Z</time>", fmt::gmtime(seconds),
                         milliseconds % 1000);
    }
    out += "</trkpt>\n";
  }
  return out + "    </trkseg>\n  </trk>\n</gpx>\n";
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
