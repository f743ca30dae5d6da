#pragma once

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

/// Standard deviation of distances together, m, from the scatter of all speeds of the scene
/// (speed_noise()).
double travelled_sigma(const Scene& scene, double frame_rate, const SpeedWeights& weights);

}  // namespace camber
