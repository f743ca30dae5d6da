#pragma once

#include "camber/synth/detail/surface.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

/// Surface of a car at a place of its mesh, vehicle frame (m); the object's extent is the car's
/// length, width and height.
/// @param width  m, of the sample's footprint
/// @param lamps  whether its lights are on
Surface car_surface(const SynthObject& object, const Eigen::Vector3f& at,
                    const Eigen::Vector3f& normal, float width, bool lamps);

}  // namespace camber
