#pragma once

#include <optional>
#include <vector>

#include "camber/road/constraint.h"
#include "camber/road/road_posterior.h"
#include "camber/scale/scale_noise.h"

namespace camber {

/// The scale by the sizes of several vehicles together, against that of a road.
struct VehicleSizes {
  int vehicles = 0;        ///< that are counted
  double log_scale = 0.0;  ///< change of the logarithm of the road's scale that they fit best
  double sigma = 0.0;      ///< its standard deviation, with what a street's cars have in common
  /// Root of twice the logarithm of the likelihood ratio of that change over a road whose scale is
  /// right within its standard deviation: standard deviations.
  double sigmas_off = 0.0;
};

/// Each vehicle's measurement of the plane under it is, for a ground of known shape, one of the
/// scale. One car's size is known to some 5 %, that of several to a few per cent. Their errors have
/// a Student distribution of a few degrees of freedom (ScaleNoise): one van among cars costs little
/// at either scale, and hides nothing of what the others agree on. It is a check: the vehicles' own
/// measurements are fused one by one.
/// @param vehicles  constraints by single vehicles, linearised at `road`.
/// @return nothing where fewer than two vehicles measure the scale.
std::optional<VehicleSizes> compare_vehicle_sizes(const RoadPosterior& road,
                                                  const std::vector<Constraint>& vehicles,
                                                  const ScaleNoise& noise);

}  // namespace camber
