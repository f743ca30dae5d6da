#pragma once

#include "camber/synth/detail/texel_kernels.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// Reflectance of a house, sign, post or trunk at some places of its texture (m).
/// @param out     red, green, blue: c.n each
/// @param mirror  c.n: share of a mirror's reflection
void wall_reflectance(const SynthObject& object, const TexelChunk& c, float* const out[3],
                      float* mirror);

}  // namespace camber
