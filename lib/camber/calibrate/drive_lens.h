#pragma once

#include <Eigen/Core>
#include <optional>

#include "camber/geometry/lens_distortion.h"

namespace camber {

/// The camera that a drive can show, and where its vehicle goes. The lens: square pixels, no skew,
/// radial distortion. With x, y of a point over its depth and r^2 = x^2 + y^2 its pixel is (cx, cy)
/// + f (1 + k1 r^2 + k2 r^4) (x, y) (Brown, "Decentering distortion of lenses", 1966; OpenCV's
/// model without its other terms).
struct DriveLens {
  static constexpr int kSize = 7;  ///< parameters: log f, cx, cy, k1, k2, yaw, pitch
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;

  int width = 0, height = 0;  ///< px
  double f = 0.0;             ///< px, > 0
  double cx = 0.0, cy = 0.0;  ///< px
  double k1 = 0.0, k2 = 0.0;
  /// rad, of the optical axis against the way straight on, positive: to the right of it, above it.
  double yaw = 0.0, pitch = 0.0;

  Vector parameters() const;
  /// The same lens with other parameters, in the order of kSize.
  DriveLens with(const Vector& parameters) const;

  struct Projection {
    Eigen::Vector2d pixel;
    Eigen::Matrix<double, 2, 3> by_point;     ///< derivative by the point, camera frame
    Eigen::Matrix<double, 2, kSize> by_lens;  ///< by the parameters
  };
  /// The pixel of a point with its derivatives; nothing unless it is in front of the camera.
  std::optional<Projection> project(const Eigen::Vector3d& x_in_cam) const;
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector3d& x_in_cam) const;
  /// The point with z = 1 on a pixel's viewing ray; nothing beyond the radius at which the model
  /// folds back.
  std::optional<Eigen::Vector3d> ray(const Eigen::Vector2d& pixel) const;

  PinholeCamera pinhole() const;  ///< the same without distortion
  /// As a manifest has it: kBrown with k1 k2 0 0 0, or kNone where both are 0.
  LensDistortion distortion() const;
};

}  // namespace camber
