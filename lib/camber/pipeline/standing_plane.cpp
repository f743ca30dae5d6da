#include "camber/pipeline/standing_plane.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace camber {

std::optional<UncertainPlane> standing_plane(const VehicleEstimate& vehicle,
                                             const VehicleFitOptions& options) {
  if (vehicle.status != Status::kOk && vehicle.status != Status::kWeak) return std::nullopt;
  // Placed by its box alone, a vehicle has its tilt from the plane.
  if (!std::isfinite(vehicle.reprojection_rmse_px)) return std::nullopt;
  if (!vehicle.covariance.allFinite() || !(vehicle.covariance.trace() > 0)) return std::nullopt;
  const Eigen::Matrix3d rotation =
      vehicle.pose.camera_from_vehicle.rotation_matrix();  // columns: front, up, right
  UncertainPlane out;
  out.centroid = vehicle.pose.bottom_center();
  out.plane = Plane::through(out.centroid, rotation.col(1));
  out.axis1 = rotation.col(0);
  out.axis2 = -rotation.col(2);
  // The bottom moves with the centre and half of the height; a turn about the vehicle's right is
  // one about -axis2.
  Eigen::Matrix<double, 3, 9> j = Eigen::Matrix<double, 3, 9>::Zero();
  j(0, 3) = 1.0;
  j(1, 5) = -1.0;
  j.block<1, 3>(2, 0) = out.plane.normal.transpose();
  j(2, 8) = -0.5;
  out.covariance = j * vehicle.covariance * j.transpose();
  out.covariance.diagonal() += Eigen::Vector3d(std::pow(options.stance_sigma_tilt, 2),
                                               std::pow(options.stance_sigma_tilt, 2),
                                               std::pow(options.stance_sigma_height, 2));
  return out;
}

}  // namespace camber
