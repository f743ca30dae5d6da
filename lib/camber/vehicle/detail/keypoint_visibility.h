#pragma once

// Which of the 36 keypoints are used, and which a view of a vehicle can show.

#include <Eigen/Core>

#include "camber/vehicle/fit_vehicle.h"

namespace camber::internal {

bool in_keypoint_set(KeypointSet set, int keypoint);

/// Whether the camera is on the side of the vehicle on which a keypoint can be seen.
/// @param eye, p  the camera and the keypoint, vehicle frame.
bool shown_to(const Eigen::Vector3d& eye, int keypoint, const Eigen::Vector3d& p);

}  // namespace camber::internal
