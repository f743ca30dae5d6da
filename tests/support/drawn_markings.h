#pragma once

#include <cstdint>
#include <functional>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"
#include "camber/image/image.h"

namespace camber::test {

/// Whether there is paint at a place of the road: x to the right, z ahead of the camera, m along
/// the surface.
using Paint = std::function<bool(double, double)>;

/// The road of a tilted plane: coordinates count from the foot below the camera, z along the view.
GrayImage draw_markings(const PinholeCamera& camera, const Plane& road, const Paint& paint,
                        double noise, std::uint64_t seed);

/// Where a pixel's ray meets the plane, m along it from the foot: (x, z).
Eigen::Vector2d on_plane(const PinholeCamera& camera, const Plane& road,
                         const Eigen::Vector2d& pixel);

/// The pixel of such a place.
Eigen::Vector2d pixel_on_plane(const PinholeCamera& camera, const Plane& road,
                               const Eigen::Vector2d& place);

/// Strokes of 3 m every 9 m, 0.12 m wide, the first from `start` on, on a line at x = `offset`.
bool dashed(double x, double z, double offset, double start);

}  // namespace camber::test
