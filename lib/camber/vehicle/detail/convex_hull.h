#pragma once

#include <vector>

#include "camber/vehicle/vehicle_estimate.h"

namespace camber::internal {

/// A face of a convex hull: n . x <= offset inside.
struct HalfSpace {
  Eigen::Vector3d normal;
  double offset;
};

/// Faces of the convex hull of a vehicle's keypoints, by trying all triples.
std::vector<HalfSpace> convex_hull(const std::array<Eigen::Vector3d, kNumKeypoints>& points);

/// Depth z at which the ray (z = 1) enters the hull; 0: it does not.
double hull_depth(const std::vector<HalfSpace>& hull, const Eigen::Vector3d& ray);

}  // namespace camber::internal
