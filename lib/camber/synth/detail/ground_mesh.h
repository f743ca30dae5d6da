#pragma once

#include <cstdint>

#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

inline constexpr double kRoadBegin = -16.0, kRoadEnd = 420.0;  ///< m of station that are made

/// Adds the ground to a mesh: road, kerbs with their upright faces, pavements, pads and verges.
/// Every vertex lies on the road model's surface.
/// @param contrast  of the asphalt's texture
void build_ground(const RoadModel& road, std::uint32_t seed, float contrast, SynthMesh* mesh);

}  // namespace camber
