#include "camber/pipeline/stages/camera_uncertainty.h"

#include <algorithm>
#include <cmath>

#include "camber/pipeline/stages/judge.h"
#include "camber/scale/camera_uncertainty.h"

namespace camber::stages {
namespace {

/// From the first camera to the last; the optical axis where there is one camera.
Eigen::Vector3d path_direction(const RunDocument& run) {
  if (run.cameras.size() < 2) return Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d path = run.cameras.back().reference_from_camera.translation() -
                               run.cameras.front().reference_from_camera.translation();
  return path.norm() > 0.0 ? path : Eigen::Vector3d::UnitZ();
}

RunDocument::Calibration described(const LoadedFrames& frames) {
  RunDocument::Calibration out;
  out.sigma = frames.camera_sigma;
  const double half = 0.5 * frames.camera.width / frames.camera.fx;
  out.field_of_view = 2.0 * std::atan(half);
  out.field_of_view_sigma = 2.0 * half / (1.0 + half * half) * frames.camera_sigma.focal;
  return out;
}

void widen(const CameraUncertainty& camera, VehicleEstimate* vehicle) {
  const Eigen::Vector3d center = vehicle->pose.center();
  if (!center.allFinite()) return;
  vehicle->covariance.topLeftCorner<3, 3>() += camera.position_covariance(center);
  UncertainPlane plane;
  plane.plane = vehicle->plane;
  plane.centroid = vehicle->plane.foot(vehicle->pose.bottom_center());
  UncertainPlane::make_axes(plane.plane.normal, Eigen::Vector3d::UnitZ(), &plane.axis1,
                            &plane.axis2);
  vehicle->plane_sigma_height =
      std::hypot(vehicle->plane_sigma_height, std::sqrt(camera.plane_covariance(plane)(2, 2)));
}

}  // namespace

void include_camera_sigma(const LoadedFrames& frames, AssembledRoad* road) {
  const CameraUncertainty camera(frames.camera, frames.camera_sigma, road->scale_by_focal);
  if (camera.exact()) return;
  RunDocument& run = road->run;
  const Eigen::Vector3d path = path_direction(run);
  run.calibration = described(frames);
  run.calibration->sigma_of_scale = std::sqrt(camera.log_length_variance_by_focal(path));
  RoadSurface& surface = road->surface;
  const double sigma = std::hypot(run.scale_sigma, std::sqrt(camera.log_length_variance(path)));
  state({sigma, run.scale_status, run.scale_reason}, &run, &surface);
  for (PlanePatch& patch : surface.patches) {
    patch.plane.covariance += camera.plane_covariance(patch.plane);
    if (!patch.without_vehicle) continue;
    patch.without_vehicle->covariance += camera.plane_covariance(*patch.without_vehicle);
  }
  for (VehicleFrame& frame : road->vehicles.frames) {
    for (VehicleEstimate& vehicle : frame.vehicles) widen(camera, &vehicle);
  }
  RoadCloud& cloud = road->cloud;
  for (std::size_t i = 0; i < std::min(cloud.points.size(), cloud.sigmas.size()); ++i) {
    const double variance = camera.distance_variance(cloud.points[i].cast<double>());
    cloud.sigmas[i] = static_cast<float>(std::hypot(cloud.sigmas[i], std::sqrt(variance)));
  }
}

}  // namespace camber::stages
