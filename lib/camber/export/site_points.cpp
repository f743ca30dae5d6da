#include "camber/export/site_points.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace camber {

SiteSpacing::SiteSpacing(double metres) : side_(4.0 / metres) {}

void SiteSpacing::add(const Eigen::Vector3d& place) {
  constexpr std::size_t kMostSquares = 2000000;
  const auto along = [&](double v) {
    return static_cast<std::uint32_t>(static_cast<std::int64_t>(std::floor(v / side_)));
  };
  const std::uint64_t square = std::uint64_t{along(place.x())} << 32 | along(place.y());
  const auto found = squares_.find(square);
  if (found != squares_.end()) {
    ++found->second;
  } else if (squares_.size() < kMostSquares) {
    squares_.emplace(square, 1);
  }
}

double SiteSpacing::spacing() const {
  if (squares_.empty()) return 0.0;
  std::vector<std::uint32_t> counts;
  for (const auto& [square, count] : squares_) counts.push_back(count);
  const auto middle = counts.begin() + static_cast<std::ptrdiff_t>(counts.size() / 2);
  std::nth_element(counts.begin(), middle, counts.end());
  return side_ / std::sqrt(static_cast<double>(*middle));
}

double site_cell(double ground_spacing) {
  const double length = 0.75 * ground_spacing;
  const double power = std::pow(10.0, std::floor(std::log10(length)));
  for (const double step : {5.0, 2.0}) {
    if (step * power <= length * (1.0 + 1e-9)) return step * power;
  }
  return power;
}

double site_reach(double cell, double ground_spacing, double fill_holes) {
  return std::max({1.5 * cell, 2.0 * ground_spacing, 0.5 * fill_holes});
}

}  // namespace camber
