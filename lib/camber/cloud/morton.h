#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace camber {

/// An order of the points in which points near each other in space are near each other in the list:
/// along the Morton (Z) curve through the bounds of the finite points, 21 bits an axis. Equal codes
/// keep their order; points that are not finite come last.
/// @return indices into `points`; deterministic.
std::vector<int> morton_order(const std::vector<Eigen::Vector3f>& points);

/// The place of a cell of the plan on the Morton curve: the bits of x and y in turn.
std::uint64_t morton_code(std::uint32_t x, std::uint32_t y);

}  // namespace camber
