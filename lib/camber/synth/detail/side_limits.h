#pragma once

#include <vector>

#include "camber/synth/road_profile.h"

namespace camber {

/// How far to its sides a winding road's ground may reach before it would meet that of another
/// stretch: short of the middle of the circles that its bends are on, and half a metre more for
/// every metre of station away from such a bend. Depends on the road alone.
class SideLimits {
 public:
  explicit SideLimits(const RoadProfile& profile);
  /// m from the centreline. @param side  0 left, 1 right
  double at(double station, int side) const;

 private:
  double begin_ = 0.0;
  std::vector<double> limits_[2];  ///< one a metre of station
};

}  // namespace camber
