#include "camber/vehicle/support_plane.h"

namespace camber {

namespace {

const Eigen::Vector3d kUp(0.0, -1.0, 0.0);

SupportPlane make_support(const Plane& plane, const Eigen::Vector3d& centroid, double sigma_height,
                          double sigma_tilt, const std::string& source) {
  SupportPlane out;
  out.plane.plane = plane;
  out.plane.centroid = centroid;
  UncertainPlane::make_axes(plane.normal, Eigen::Vector3d(0.0, 0.0, 1.0), &out.plane.axis1,
                            &out.plane.axis2);
  out.plane.covariance =
      Eigen::Vector3d(sigma_tilt * sigma_tilt, sigma_tilt * sigma_tilt, sigma_height * sigma_height)
          .asDiagonal();
  out.source = source;
  return out;
}

}  // namespace

SupportPlane given_support(const PinholeCamera& camera, const VehicleDetection& detection,
                           const SupportOptions& options) {
  const Plane plane = detection.given_plane.oriented(kUp);
  const Eigen::Vector3d ray = camera.ray({detection.box.center().x(), detection.box.y2});
  Eigen::Vector3d centroid = plane.foot(Eigen::Vector3d::Zero());
  if (const auto hit = plane.intersect_ray(ray)) {
    if (hit->z() > 1.0 && hit->z() < 200.0) centroid = *hit;
  }
  return make_support(plane, centroid, options.given_sigma_height, options.given_sigma_tilt,
                      "given");
}

SupportPlane ego_support(const Plane& ego_plane, const SupportOptions& options) {
  const Plane plane = ego_plane.oriented(kUp);
  return make_support(plane, plane.foot(Eigen::Vector3d::Zero()), options.ego_sigma_height,
                      options.ego_sigma_tilt, "ego");
}

SupportPlane level_support(double height, const SupportOptions& options) {
  const Plane plane{kUp, height};
  return make_support(plane, plane.foot(Eigen::Vector3d::Zero()), options.level_sigma_height,
                      options.level_sigma_tilt, "level");
}

SupportPlane certain_support(const Plane& plane, const std::string& source) {
  const Plane up = plane.oriented(kUp);
  return make_support(up, up.foot(Eigen::Vector3d::Zero()), kCertainSigma, kCertainSigma, source);
}

}  // namespace camber
