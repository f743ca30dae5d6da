#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/status.h"
#include "camber/geometry/plane.h"

namespace camber {

struct PlaneFitOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;                ///< <= 0: see resolve_num_threads
  Eigen::Vector3d up{0.0, 0.0, 1.0};  ///< the fitted normal is on this side; unit not needed
  double max_tilt = 0.7;              ///< rad between the normal and up, (0, pi / 2]
  /// m; > 0: one inlier threshold for all points. 0: 2.5 standard deviations of each point if the
  /// cloud has sigmas or covariances, else of the noise estimated from the cloud.
  double inlier_threshold = 0.0;
  int max_hypotheses = 2000;   ///< > 0
  double confidence = 0.9999;  ///< of the adaptive stop, (0, 1)
  /// Where the points were seen from, in the cloud's true coordinates (origin included): sigmas are
  /// then standard deviations along the rays from there. Not given: the frame's origin for clouds
  /// in a camera's frame; for others it is unknown, and how a point's sigma shows across the plane
  /// is learnt from the cloud.
  std::optional<Eigen::Vector3d> viewpoint;
  bool list_inliers = true;  ///< false: leaves PlaneFit::inliers empty

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

struct PlaneFit {
  Status status = Status::kNotRun;  ///< see reason, unless kOk
  std::string reason;
  UncertainPlane plane;         ///< frame of the input cloud, origin included
  std::vector<int> inliers;     ///< ascending indices into the input
  std::size_t num_inliers = 0;  ///< points within the inlier threshold of the plane
  /// m, standard deviation of a point about the plane, whatever the threshold is; of points with
  /// unequal sigmas the root of their variances' harmonic mean; NaN for up to three points. See
  /// measured_noise().
  double noise = std::numeric_limits<double>::quiet_NaN();
  /// Corners, in order, of the part of the plane that carries the fit; empty unless one was fitted.
  std::vector<Eigen::Vector3d> extent;
  double rmse = std::numeric_limits<double>::quiet_NaN();       ///< m along the normal, inliers
  double condition = std::numeric_limits<double>::quiet_NaN();  ///< of the normal equations, >= 1
  int hypotheses = 0;  ///< minimal samples that were scored
};

/// Fits the dominant plane of a cloud with outliers, weighing each point by its own uncertainty
/// along the plane's normal. Non-finite points are skipped.
///
/// Minimal samples, half of them from one neighbourhood, are scored on a fixed random subset (MSAC:
/// Torr and Zisserman, "MLESAC", CVIU 2000) and refined locally (Chum, Matas, Kittler, DAGM 2003).
/// The winner is refined with Tukey's biweight inside the part of the plane that the points cover
/// evenly: at an edge, noise along the viewing rays carries points out on one side only, and
/// beyond a crease the next plane begins; both would tilt the fit. One Newton step over all points
/// ends it. The covariance is that of the M-estimator (the "sandwich" of Huber, "Robust
/// Statistics", section 6.3), so it holds for noise that differs from point to point.
///
/// Same seed, same answer, for any number of threads. Status kFailed with fewer than 3 usable
/// points or no plane within max_tilt; kNotObservable where the points lie on a line (the plane
/// through it that is nearest to level is given); kWeak where the tilt's standard deviation is
/// above 0.02 rad, too few points are left to measure the noise, the surface bends away from any
/// plane by more than its noise, or the threshold given: the fit is then of the points within the
/// least threshold at which more of them lie on a plane than leave it, and the covariance holds the
/// bend; or the points scatter by more than that threshold: the fit is of those within 2.5 standard
/// deviations.
/// @throws std::invalid_argument if options.validate() fails.
PlaneFit fit_plane(const RoadCloud& cloud, const PlaneFitOptions& options);

/// The same for n points in separate arrays, metres. @param sigma one standard deviation a point,
/// m, or nullptr. Rays are used only if options.viewpoint is given.
PlaneFit fit_plane(const float* x, const float* y, const float* z, const float* sigma,
                   std::size_t n, const PlaneFitOptions& options);

}  // namespace camber
