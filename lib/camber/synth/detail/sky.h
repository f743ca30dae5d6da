#pragma once

#include "camber/synth/detail/surface.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// Light of the sky, clouds and far hills in a direction (world, any length).
Color sky_light(const SynthWorld& world, const Eigen::Vector3d& direction);

/// Light of the surroundings that a car's paint or a window mirrors: sky above, a street below.
Color mirrored_surroundings(const SynthWorld& world, const Eigen::Vector3d& direction);

}  // namespace camber
