#pragma once

#include "camber/synth/detail/surface.h"
#include "camber/synth/detail/texel_kernels.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// Reflectance of asphalt, a kerb, slabs or grass at some places of its texture (m along the street
/// in space and across it, see the ground's mesh).
/// @param out  red, green, blue: c.n each
void ground_reflectance(const SynthWorld& world, const SynthObject& object, const TexelChunk& c,
                        float* const out[3]);

/// Water on asphalt.
struct WaterFilm {
  float film = 0.0f;    ///< 0 dry, 1 wet all over
  float puddle = 0.0f;  ///< share of standing water
};
WaterFilm water_film(float wetness, const SynthObject& object, Texel place, float width);

}  // namespace camber
