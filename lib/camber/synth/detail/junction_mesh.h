#pragma once

#include <cstdint>

#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// The ground of a road with a junction: a grid in the road's station and offset whose cells are
/// cut along the edges of carriageway, kerb and pavement, with upright kerb faces. Fine around the
/// junction and along the road up to it, coarser beyond.
void build_junction_ground(const RoadModel& road, std::uint32_t seed, float contrast,
                           SynthMesh* mesh);

}  // namespace camber
