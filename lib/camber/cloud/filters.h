#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber {

/// Indices of the points whose three coordinates are finite, ascending.
std::vector<int> finite_points(const RoadCloud& cloud);

/// Axis-aligned box in true coordinates (origin included), m; limits may be infinite.
struct CropBox {
  Eigen::Vector3d minimum = Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity());
  Eigen::Vector3d maximum = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());

  bool contains(const Eigen::Vector3d& x) const {
    return (x.array() >= minimum.array()).all() && (x.array() <= maximum.array()).all();
  }
};

/// Indices of the points inside (or, inverted, outside) a box, limits included, ascending. Points
/// that are not finite are in neither.
std::vector<int> crop(const RoadCloud& cloud, const CropBox& box, bool inverted = false);

/// Indices of the points whose mean distance to their `neighbors` nearest other points is at most
/// the mean of these distances over the cloud plus `deviations` of their standard deviations,
/// ascending. Points that are not finite are dropped; so are all if there is only one.
/// @param neighbors  >= 1
/// @param deviations finite
/// @throws std::invalid_argument naming the bad argument.
/// Same answer for any num_threads. Rusu et al., "Towards 3D point cloud based object maps for
/// household environments", RAS 2008; the rule is that of PCL's StatisticalOutlierRemoval.
std::vector<int> statistical_inliers(const RoadCloud& cloud, int neighbors, double deviations,
                                     int num_threads = 0);

/// Indices of the points with at least `neighbors` other points at most `radius` away, ascending.
/// @param radius    m, > 0; needs a metric cloud
/// @param neighbors >= 1
/// @throws std::invalid_argument naming the bad argument. Same answer for any num_threads.
std::vector<int> radius_inliers(const RoadCloud& cloud, double radius, int neighbors,
                                int num_threads = 0);

}  // namespace camber
