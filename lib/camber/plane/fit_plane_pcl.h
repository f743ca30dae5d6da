#pragma once

#include "camber/plane/fit_plane.h"

namespace camber {

/// The same question put to the Point Cloud Library, to check one engine against the other:
/// MSAC over perpendicular planes, one threshold for all points, refined by least squares over the
/// inliers. options.inlier_threshold 0 means `default_threshold`. Status kFailed also where none of
/// 1000 samples in a row is within max_tilt.
/// The covariance is that of the least squares, wide where the inliers are at fewer than 12 places;
/// sigmas, viewpoint and num_threads are not used.
/// @throws std::invalid_argument if options.validate() fails or default_threshold is not positive
///         where it is needed.
PlaneFit fit_plane_pcl(const RoadCloud& cloud, const PlaneFitOptions& options,
                       double default_threshold = 0.05);

}  // namespace camber
