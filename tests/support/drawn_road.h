#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"

namespace camber::test {

/// An upright board that faces the camera's z axis, standing in the world.
struct DrawnBoard {
  double z = 0.0, left = 0.0, right = 0.0, top = 0.0, bottom = 0.0;  ///< m, world frame, y down
  double shift_per_frame = 0.0;  ///< m along z from one frame to the next
};

/// A small world for tests of the main job: ground with asphalt-like grain under a sky, boards,
/// shadows and puddles. World: x right, y down, z forward, metres.
struct DrawnRoad {
  /// y of the ground at x, z; a smooth function.
  std::function<double(double, double)> ground = [](double, double) { return 1.65; };
  std::vector<DrawnBoard> boards;
  /// Reflectance factor of the ground at x, z in a frame (shadows); 1: sunlit.
  std::function<double(double, double, int)> light = [](double, double, int) { return 1.0; };
  /// Whether the ground at x, z mirrors the sky.
  std::function<bool(double, double)> wet = [](double, double) { return false; };
};

/// Grey image of one frame. @param frame  number that moves boards and shadows.
std::vector<std::uint8_t> draw_road(const DrawnRoad& road, const PinholeCamera& camera,
                                    const SE3& world_from_camera, int frame);

/// Where a pixel's ray meets the ground (boards left out), world frame; z = NaN: nowhere.
Eigen::Vector3d meet_road(const DrawnRoad& road, const PinholeCamera& camera,
                          const SE3& world_from_camera, const Eigen::Vector2d& pixel);

}  // namespace camber::test
