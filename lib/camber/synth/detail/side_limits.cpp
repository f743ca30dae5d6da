#include "camber/synth/detail/side_limits.h"

#include <algorithm>
#include <cmath>

namespace camber {
namespace {

constexpr double kFarthest = 80.0;      // m, where no bend is near
constexpr double kShareOfRadius = 0.8;  // as far as the columns of a mesh stay apart
constexpr double kGrowth = 0.5;         // m a metre of station

}  // namespace

SideLimits::SideLimits(const RoadProfile& profile) : begin_(profile.begin()) {
  const auto count = static_cast<std::size_t>(std::ceil(profile.end() - begin_)) + 1;
  for (int side = 0; side < 2; ++side) {
    std::vector<double>& limits = limits_[side];
    limits.assign(count, kFarthest);
    for (std::size_t i = 0; i < count; ++i) {
      const double inward =
          (side == 0 ? 1.0 : -1.0) * profile.curvature(begin_ + static_cast<double>(i));
      if (inward > 0.0) limits[i] = std::min(kFarthest, kShareOfRadius / inward);
    }
    for (std::size_t i = 1; i < count; ++i) {
      limits[i] = std::min(limits[i], limits[i - 1] + kGrowth);
    }
    for (std::size_t i = count - 1; i-- > 0;) {
      limits[i] = std::min(limits[i], limits[i + 1] + kGrowth);
    }
  }
}

double SideLimits::at(double station, int side) const {
  const std::vector<double>& limits = limits_[side];
  const double x = std::clamp(station - begin_, 0.0, static_cast<double>(limits.size()) - 1.0);
  const auto before = static_cast<std::size_t>(x);
  const std::size_t after = std::min(before + 1, limits.size() - 1);
  return limits[before] + (x - static_cast<double>(before)) * (limits[after] - limits[before]);
}

}  // namespace camber
