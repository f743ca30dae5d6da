#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>
#include <vector>

namespace camber {

/// What one source measures of a camera's focal length f (px) and its height h above the road (m):
/// by_focal log f + by_height log h = value, with a normally distributed error.
struct CameraSource {
  std::string name;    ///< "epipolar_geometry", "vehicle_proportions", ...
  std::string phrase;  ///< what was measured here: "proportions of 6 vehicles"
  double by_focal = 0.0, by_height = 0.0;
  double value = 0.0;
  double sigma = 0.0;   ///< > 0, with `common`
  double common = 0.0;  ///< the part of sigma that all windows and vehicles have in common
  // Of join_sources().
  /// Standard deviations from what the accepted others let expect; NaN: they do not.
  double residual_sigma = std::numeric_limits<double>::quiet_NaN();
  bool accepted = true;
  std::string reason;  ///< why it is not accepted
};

/// Focal length and height by all sources together.
struct CameraJoint {
  Eigen::Vector2d value = Eigen::Vector2d::Zero();  ///< log f (px), log h (m)
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  double focal_sigma() const;   ///< relative
  double height_sigma() const;  ///< relative
};

/// A camera on a car to a van: what is known of its height before anything is seen.
CameraSource height_of_cars();

/// Joins sources that know nothing of each other by their information. Each is compared with all
/// others first: beyond three standard deviations the one that is farthest off is left out (of two
/// alike the later one), then the next. Where one is left out and of those kept a single one knows
/// what it measures, which of the two is right is not known: the variance is widened by
/// their difference (Birge, "The calculation of errors by the method of least squares", Phys. Rev.
/// 1932).
/// @param sources  together they determine both; residuals, acceptance and reasons are written.
/// @throws std::invalid_argument where they do not, or for a sigma that is not positive.
CameraJoint join_sources(std::vector<CameraSource>* sources);

/// How much of what is known of one of both a source brings: 1 less the variance of the joint over
/// that without it, of accepted ones.
/// @param unknown  0: log f, 1: log h.
double share_of_source(const std::vector<CameraSource>& sources, std::size_t source, int unknown);

}  // namespace camber
