#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace camber {

/// Standard deviation of a normal distribution over its median absolute deviation.
inline constexpr double kSigmaFromMad = 1.4826;

/// The upper median: of an even number of values the larger of the two in the middle. Reorders.
/// @return NaN for no values.
inline double upper_median(std::vector<double>* values) {
  if (values->empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

inline double upper_median(std::vector<double> values) { return upper_median(&values); }

}  // namespace camber
