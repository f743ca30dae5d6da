#pragma once

#include <Eigen/Core>
#include <optional>

#include "camber/geometry/lens_distortion.h"
#include "camber/geometry/pinhole_camera.h"

namespace camber {

/// Between the pixels of a pinhole camera and those of the image files of its lens (Brown, "Close-
/// range camera calibration", 1971; Kannala and Brandt, "A generic camera model", PAMI 2006, with
/// OpenCV's coefficients). Beyond the angle at which a polynomial turns back nothing is known.
class LensMap {
 public:
  /// @throws std::invalid_argument as LensDistortion::validate().
  LensMap(const PinholeCamera& camera, const LensDistortion& lens);

  /// Where the file shows what the camera sees at a pixel; nothing beyond the lens's model. May lie
  /// outside the file.
  std::optional<Eigen::Vector2d> raw_from_pinhole(const Eigen::Vector2d& pixel) const;

  /// The inverse, to 1e-9 px where it exists; nothing for rays at 90 degrees and more.
  std::optional<Eigen::Vector2d> pinhole_from_raw(const Eigen::Vector2d& pixel) const;

 private:
  /// Radius on the distorted normalised plane of a ray with that radius, and its derivative.
  double radius(double ideal, double* derivative) const;
  Eigen::Vector2d distorted(const Eigen::Vector2d& ideal) const;

  PinholeCamera camera_;
  LensDistortion lens_;
  double k_[6] = {};    // radial: k1 k2 k3 k4 k5 k6
  double p_[2] = {};    // tangential
  double limit_ = 0.0;  // largest radius (brown) or angle (fisheye) of the model
};

/// A pinhole camera that loses nothing of the road: focal lengths as the lens's, wide and high
/// enough for the file's middle row and column and its lower border, at most 62 degrees off the
/// axis and twice the file's size.
PinholeCamera undistorted_camera(const LensDistortion& lens);

}  // namespace camber
