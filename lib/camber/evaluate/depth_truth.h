#pragma once

#include <set>

#include "camber/evaluate/compare.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"

namespace camber {

/// The ground of a depth image as a mesh in its camera's frame: a point a pixel, a triangle between
/// three neighbours whose depths differ by at most 0.3 m or 15 % (no surface is seen between the
/// two sides of a crest).
/// @param labels   1 channel, of the depth's size; nullptr: every pixel counts
/// @param classes  values of the ground
/// @param largest  m along z
/// Without a triangle the shape is empty. @throws std::invalid_argument if sizes differ.
Shape ground_mesh_from_depth(const DepthImage& depth, const PinholeCamera& camera,
                             const Image* labels, const std::set<int>& classes, double largest);

}  // namespace camber
