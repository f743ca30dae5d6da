#pragma once

#include <cstdint>

#include "camber/synth/detail/side_limits.h"
#include "camber/synth/road_model.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

inline constexpr double kRoadBegin = -16.0, kRoadEnd = 420.0;  ///< m of station that are made

/// Along which stations the ground is made, and in which steps.
struct GroundReach {
  double begin = kRoadBegin, end = kRoadEnd;  ///< m
  double fine_end = 90.0;                     ///< rows every 0.25 m before it,
  double medium_end = 160.0;                  ///< every 0.5 m before it, then every 2 m
  /// Where the ground ends to the sides; nullptr: the same all along, by the tightest bend.
  const SideLimits* limits = nullptr;
};

/// Adds the ground to a mesh: road, kerbs with their upright faces, pavements, pads and verges.
/// Every vertex lies on the road model's surface.
/// @param contrast  of the asphalt's texture
/// @param reach     of a road without junction; whole multiples of 2 m keep the rows of two reaches
/// on each other
void build_ground(const RoadModel& road, std::uint32_t seed, float contrast, SynthMesh* mesh,
                  const GroundReach& reach = {});

}  // namespace camber
