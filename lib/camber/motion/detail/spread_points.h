#pragma once

#include <cstdint>
#include <vector>

#include "camber/motion/correspondences.h"

namespace camber::detail {

/// A spread choice of at most `count` points: the image is divided into square cells, and each
/// gives its best-textured candidate (smallest eigenvalue of the structure tensor).
/// @param candidate  one entry a grid point
/// @return grid points, ascending by cell
std::vector<int> spread_points(const Correspondences& matches,
                               const std::vector<std::uint8_t>& candidate, int count);

}  // namespace camber::detail
