#pragma once

#include <cstdint>

#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// Adds houses, lamps, marker posts, signs, bushes and trees beside the road, and beside the street
/// of a junction. Same road and seed, same things.
void build_scenery(const RoadModel& road, std::uint64_t seed, SynthMesh* mesh);

}  // namespace camber
