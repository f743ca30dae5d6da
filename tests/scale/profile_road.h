#pragma once

#include <cmath>
#include <functional>

#include "camber/geometry/pinhole_camera.h"

namespace camber::test {

// A road whose height below the camera is a function of the distance ahead, m.
using Profile = std::function<double(double)>;

constexpr double kRoadHeight = 1.65;  // m
inline const PinholeCamera kRoadCamera{960, 400, 600.0, 600.0, 480.0, 150.0};

inline double level(double) { return kRoadHeight; }
/// A hill that begins 12 m ahead, with a radius of 200 m.
inline double hill(double z) {
  return kRoadHeight - (z > 12.0 ? (z - 12.0) * (z - 12.0) / 400.0 : 0.0);
}

/// Depth at which a row meets the road, by bisection, m.
inline double depth_of(double v, const Profile& height) {
  const double slope = (v - kRoadCamera.cy) / kRoadCamera.fy;
  double low = 1.0, high = 120.0;
  for (int i = 0; i < 80; ++i) {
    const double middle = 0.5 * (low + high);
    (slope * middle < height(middle) ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace camber::test
