#pragma once

#include <cstddef>
#include <vector>

namespace camber::detail {

/// Unknown values (NaN) from their known neighbours, linearly; all unknown: zero.
void bridge(std::vector<double>* values);

/// Straight-line fits over a window of `half` values to either side, so that a ramp stays a ramp.
std::vector<double> smoothed(const std::vector<double>& values, std::size_t half);

}  // namespace camber::detail
