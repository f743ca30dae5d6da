#include "camber/vehicle/detail/keypoint_visibility.h"

#include "camber/vehicle/shape_prior.h"

namespace camber::internal {

bool in_keypoint_set(KeypointSet set, int keypoint) {
  constexpr bool kInSmallSet[kNumSideKeypoints] = {true,  true,  false, false, false, false,
                                                   false, false, false, false, false, true,
                                                   false, true,  true,  true,  true,  false};
  return set == KeypointSet::kAll36 || kInSmallSet[keypoint % kNumSideKeypoints];
}

bool shown_to(const Eigen::Vector3d& eye, int keypoint, const Eigen::Vector3d& p) {
  const int row = keypoint % kNumSideKeypoints;
  const double side = keypoint < kNumSideKeypoints ? -1.0 : 1.0;
  if (side * (eye.z() - p.z()) > 0.0) return true;
  // Corners are seen from their end of the car as well; roof corners from above.
  if (row >= 10 && row <= 12) return eye.x() < p.x();
  if (row >= 15) return eye.x() > p.x();
  if (row == 13) return eye.x() < p.x() || eye.y() > p.y();
  if (row == 14) return eye.x() > p.x() || eye.y() > p.y();
  return false;
}

}  // namespace camber::internal
