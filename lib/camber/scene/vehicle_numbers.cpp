#include "camber/scene/vehicle_numbers.h"

#include <algorithm>
#include <cmath>

namespace camber {

VehicleNumbers::VehicleNumbers(const VehicleDocument& document) {
  int next = 0;
  for (const VehicleFrame& frame : document.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) next = std::max(next, vehicle.track + 1);
  }
  if (next == 0) return;
  for (const VehicleFrame& frame : document.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      if (vehicle.track < 0 && untracked_.emplace(std::pair{frame.id, vehicle.id}, next).second) {
        ++next;
      }
    }
  }
}

int VehicleNumbers::of(int frame, const VehicleEstimate& vehicle) const {
  if (vehicle.track >= 0) return vehicle.track;
  const auto found = untracked_.find({frame, vehicle.id});
  return found != untracked_.end() ? found->second : vehicle.id;
}

double range_sigma(const VehicleEstimate& vehicle) {
  const Eigen::Matrix3d covariance = vehicle.covariance.topLeftCorner<3, 3>();
  const Eigen::Vector3d ray = vehicle.pose.bottom_center().normalized();
  const double variance = ray.dot(covariance * ray);
  return variance > 0.0 && std::isfinite(variance) ? std::sqrt(variance) : 0.0;
}

std::string vehicle_name(const VehicleEstimate& vehicle, int number) {
  return (vehicle.vehicle_class.empty() ? "vehicle" : vehicle.vehicle_class) + " " +
         std::to_string(number);
}

}  // namespace camber
