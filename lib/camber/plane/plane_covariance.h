#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>

#include "camber/core/status.h"
#include "camber/plane/plane_solver.h"

namespace camber {

inline constexpr std::size_t kFewPlaces = 12;  ///< of points: residuals do not show their spread
inline constexpr double kWeakTilt = 0.02;  ///< rad, standard deviation above which a fit is weak

/// A fitted plane with its uncertainty, relative to the pivot.
struct PlaneEstimate {
  UncertainPlane plane;
  double noise = std::numeric_limits<double>::quiet_NaN();      ///< m, see measured_noise()
  double condition = std::numeric_limits<double>::quiet_NaN();  ///< >= 1
  double points = 0.0;                                          ///< that carry the fit, copies once
  /// Not observable since more points leave the plane, on both of its axes, than lie on it.
  bool bends = false;
  Status status = Status::kNotRun;
  std::string reason;
};

/// What noise along viewing rays that are not known does to a plane, however many points there are.
///
/// Rays from above part on their way: what noise carries towards the viewer, up and off the
/// surface, is crowded together, the rest is thinned out. So what lies at a place is on average
/// above the surface, by about the relative range noise (1 % is assumed) times the noise across it:
/// `rise`, known to a half of it. Along the way the points are on average off by what var(e) sin a
/// cos a changes, with e the error along a ray that meets the surface at the angle a. That tilts a
/// plane whose noise is uneven, as it is beyond a crease, where rays from before it meet the road
/// steeper or flatter. Standard deviation: 0.08 of the noise over the points' root mean square
/// distance, times the relative change of the variance, found on made clouds of chains of planes.
struct UnknownRays {
  double rise = 0.0;                    ///< m
  double slope_u = 0.0, slope_v = 0.0;  ///< rad, standard deviations along the window's axes
};

/// From the residuals' variance and how it changes along the axes of a window. Slopes are zero
/// without a window or with fewer than 200 points. @param points  weights up to date for the plane
UnknownRays unknown_rays(const PointArrays& points, const PivotPlane& plane,
                         const PlaneWindow& window);

/// Standard deviation of the points about a plane inside a window, m: of the normal part of their
/// residuals over an even background, whatever their weights were chosen as; NaN for three points
/// or fewer, which lie on any plane. Of points with unequal weights that of equal ones which would
/// fix the plane's height as well: the harmonic mean of the weights' variances, times the
/// residuals' own in standard deviations.
/// @param points  weights up to date for the plane
double measured_noise(const PointArrays& points, const PivotPlane& plane,
                      const PlaneWindow& window);

/// What is known of the errors of a plane's points.
struct PlanePointErrors {
  double noise = std::numeric_limits<double>::quiet_NaN();  ///< m, see measured_noise()
  double places = 0.0;  ///< at which points carry the fit: copies of a point count once
  /// m, standard deviation of an error that all points may share, and that may vary over them as
  /// slowly as a plane's height does; the covariance holds it
  double shared = 0.0;
};

/// Covariance of the M-estimator, condition and status. axis1 is the direction of largest spread.
/// @param full        kNewton sums at the plane over all points
/// @param influence   kNewton sums with psi^2 over all or a part of them
/// @param rays        given where viewing rays are not known: the plane is lowered by the rise, and
///                    the covariance holds what is not known of it
PlaneEstimate estimate_covariance(const PivotPlane& plane, const PlaneWindow& window,
                                  const plane_kernels::Moments& full,
                                  const plane_kernels::Moments& influence,
                                  const PlanePointErrors& errors, const Eigen::Vector3d& up,
                                  const std::optional<UnknownRays>& rays);

}  // namespace camber
