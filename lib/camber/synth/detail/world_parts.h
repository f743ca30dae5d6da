#pragma once

#include "camber/core/random.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// What a world's options leave open, drawn by their seed.

inline constexpr std::uint64_t kMarkingStream = 0x4D41524B;  ///< of markings and texture

/// Pads reach as far as the farthest car may be.
RoadLayout draw_layout(const WorldOptions& options);
MarkingSizes draw_markings(const WorldOptions& options, const CounterRandom& random);
SynthLight draw_light(const WorldOptions& options);

struct GroundTexture {
  std::uint32_t seed = 0;
  float contrast = 1.0f;
};
GroundTexture draw_texture(const WorldOptions& options, const CounterRandom& random);

}  // namespace camber
