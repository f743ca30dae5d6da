#pragma once

#include <cmath>
#include <map>
#include <optional>

#include "camber/scene/scene.h"

namespace camber {

/// How long each frame's speed counts in distances, s, by frame id.
using SpeedWeights = std::map<int, double>;

/// The distance between two frames, m: the integral of the speeds of all frames from one to the
/// other, linear between them. Nothing where one of the two has none.
/// @param frame_rate  Hz, of frames without a time.
/// @param weights     what the speeds count for in it is added.
std::optional<double> travelled_between(const Scene& scene, int from, int to, double frame_rate,
                                        SpeedWeights* weights);

/// How well distances together are known, m, standard deviations.
struct DistanceSigma {
  double own = 0.0;     ///< of these distances alone
  double common = 0.0;  ///< shared by all distances of the scene: a wheel's size, a clock
  double together() const { return std::hypot(own, common); }
};

/// From the scatter of all speeds of the scene (speed_noise()).
DistanceSigma travelled_sigma(const Scene& scene, double frame_rate, const SpeedWeights& weights);

}  // namespace camber
