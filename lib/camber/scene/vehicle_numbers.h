#pragma once

#include <map>
#include <string>
#include <utility>

#include "camber/scene/results.h"

namespace camber {

/// What pictures, reports, exports and the viewer call a vehicle, and colour it by: the same over
/// the frames of a result. An id in vehicles.json names a detection within its frame only, so that
/// one car may have another id in each.
///
/// The number is the vehicle's track. Where some vehicles of a result have tracks and others have
/// none, the others get the numbers after the last track, in the order of frames and rows; where
/// none has one, the number is the id.
class VehicleNumbers {
 public:
  VehicleNumbers() = default;
  explicit VehicleNumbers(const VehicleDocument& document);

  /// @param frame  id of the vehicle's frame
  int of(int frame, const VehicleEstimate& vehicle) const;

 private:
  std::map<std::pair<int, int>, int> untracked_;  ///< by frame and id
};

/// Standard deviation of the distance from the camera to the vehicle, m; 0: none is stated.
double range_sigma(const VehicleEstimate& vehicle);

/// "car 3"; "vehicle 3" without a class.
std::string vehicle_name(const VehicleEstimate& vehicle, int number);

}  // namespace camber
