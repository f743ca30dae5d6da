#pragma once

#include <cstdint>

#include "camber/synth/detail/side_limits.h"
#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// Adds houses, lamps, marker posts, signs, bushes and trees beside the road, and beside the street
/// of a junction. Same road and seed, same things.
void build_scenery(const RoadModel& road, std::uint64_t seed, SynthMesh* mesh);

/// A long road has its things stretch by stretch; each depends on the road, the seed and its begin.
inline constexpr double kSceneryStretch = 100.0;  ///< m of station

/// Adds those of the stretch that begins at a station, clear of a row of parked cars.
/// @param simple_from  station from which plants have fewer leaves
void build_scenery_stretch(const RoadModel& road, std::uint64_t seed, double begin,
                           double simple_from, const SideLimits& limits, SynthMesh* mesh);

}  // namespace camber
