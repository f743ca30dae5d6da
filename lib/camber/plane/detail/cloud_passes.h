#pragma once

#include <array>
#include <vector>

#include "camber/plane/detail/plane_sample.h"

/// Passes over all points of a cloud, block by block and without a copy of it. Coordinates and
/// planes are relative to the pivot.
namespace camber::detail {

/// Points on a candidate inside its window, by a fixed part of the cloud.
double count_support(const PointColumns& source, const std::array<float, 3>& pivot,
                     const PlaneCandidate& candidate);

/// Up to 65,536 points relative to the pivot: all, or evenly spread over the input. Points that are
/// not usable are put far from everything.
void load_many(const PointColumns& source, const std::array<float, 3>& pivot, PointArrays* many);

/// Sums over all points, and what the last pass finds beside them.
struct CloudMoments {
  plane_kernels::Moments moments;  ///< with Newton's weights
  std::vector<int> inliers;        ///< ascending rows, if asked for
};

/// @param expected_share  of inliers, about: room for the list
/// The same for any number of threads.
CloudMoments sum_cloud_moments(const PointColumns& source, const std::array<float, 3>& pivot,
                               const PlaneCandidate& candidate, bool finish, bool list,
                               double expected_share, int num_threads);

}  // namespace camber::detail
