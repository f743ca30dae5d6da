#pragma once

#include <Eigen/Core>
#include <optional>

namespace camber {

/// Pinhole camera without distortion. Camera frame: x right, y down, z forward (OpenCV, KITTI).
/// Pixel centres are at integer coordinates; the top-left pixel's centre is (0, 0).
struct PinholeCamera {
  int width = 0;    ///< pixels
  int height = 0;   ///< pixels
  double fx = 0.0;  ///< pixels, > 0
  double fy = 0.0;  ///< pixels, > 0
  double cx = 0.0;  ///< pixels
  double cy = 0.0;  ///< pixels

  /// Pixel (u, v) of a point in the camera frame; nothing if it is not in front (z <= 0).
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& x_in_cam) const {
    if (!(x_in_cam.z() > 0.0)) return std::nullopt;
    return Eigen::Vector2d(fx * x_in_cam.x() / x_in_cam.z() + cx,
                           fy * x_in_cam.y() / x_in_cam.z() + cy);
  }

  /// The point with z = 1 on a pixel's viewing ray, camera frame.
  Eigen::Vector3d ray(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy, 1.0};
  }

  /// Whether a pixel lies inside the image, at least `margin` pixels from the outermost centres.
  bool contains(const Eigen::Vector2d& pixel, double margin = 0.0) const {
    return pixel.x() >= margin && pixel.y() >= margin && pixel.x() <= width - 1 - margin &&
           pixel.y() <= height - 1 - margin;
  }

  Eigen::Matrix3d matrix() const;

  /// Throws std::invalid_argument naming the first unusable field (non-finite, not positive).
  void validate() const;
};

}  // namespace camber
