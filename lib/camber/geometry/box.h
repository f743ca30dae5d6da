#pragma once

#include <Eigen/Core>
#include <algorithm>

#include "camber/geometry/se3.h"

namespace camber {

/// Axis-aligned box in an image, pixels; x1 <= x2, y1 <= y2.
struct Box2 {
  double x1 = 0.0, y1 = 0.0, x2 = 0.0, y2 = 0.0;

  double width() const { return x2 - x1; }
  double height() const { return y2 - y1; }
  double area() const { return std::max(0.0, width()) * std::max(0.0, height()); }
  Eigen::Vector2d center() const { return {0.5 * (x1 + x2), 0.5 * (y1 + y2)}; }
  bool contains(const Eigen::Vector2d& p) const {
    return p.x() >= x1 && p.x() <= x2 && p.y() >= y1 && p.y() <= y2;
  }
  /// The box with both sides scaled about its centre.
  Box2 scaled(double factor) const {
    const Eigen::Vector2d c = center();
    return {c.x() - 0.5 * factor * width(), c.y() - 0.5 * factor * height(),
            c.x() + 0.5 * factor * width(), c.y() + 0.5 * factor * height()};
  }
  Box2 grown(double margin) const { return {x1 - margin, y1 - margin, x2 + margin, y2 + margin}; }
  /// The part inside an image of the given size; may be empty (area 0).
  Box2 clipped(int image_width, int image_height) const {
    return {std::clamp(x1, 0.0, image_width - 1.0), std::clamp(y1, 0.0, image_height - 1.0),
            std::clamp(x2, 0.0, image_width - 1.0), std::clamp(y2, 0.0, image_height - 1.0)};
  }
};

/// Intersection over union of two boxes, in [0, 1].
double intersection_over_union(const Box2& a, const Box2& b);

/// Size of a vehicle's full bounding box, m.
struct Dimensions {
  double length = 0.0, width = 0.0, height = 0.0;
};

/// Oriented box of a vehicle. Vehicle frame: x to the front, y up, z to the right; origin at the
/// middle of the box's bottom face.
struct OrientedBox {
  SE3 camera_from_vehicle;
  Dimensions dimensions;

  Eigen::Vector3d bottom_center() const { return camera_from_vehicle.translation(); }
  Eigen::Vector3d center() const;
  /// Corners 0-3: the bottom face (front left, front right, rear right, rear left); 4-7 above them.
  Eigen::Matrix<double, 3, 8> corners() const;
};

/// KITTI's rotation_y of a vehicle rotation: atan2(-f_z, f_x) of its front axis f in the camera.
double rotation_y(const Eigen::Matrix3d& camera_from_vehicle);

/// Rotation of an upright vehicle with KITTI's rotation_y: columns front, up, right in the camera.
Eigen::Matrix3d rotation_from_rotation_y(double ry);

}  // namespace camber
