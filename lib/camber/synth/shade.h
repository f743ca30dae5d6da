#pragma once

#include <Eigen/Core>

#include "camber/synth/synth_world.h"

namespace camber {

/// Linear light, red green blue; 1 is a white surface in full light.
using Radiance = Eigen::Vector3f;

/// A viewing ray with its change from one sample to the next, world frame.
struct ViewRay {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;  ///< any length
  Eigen::Vector3d along_x;    ///< change of the direction to the sample on the right
  Eigen::Vector3d along_y;    ///< change to the sample below
  std::uint32_t random = 0;   ///< hash of the sample, for soft shadows
};

/// Light that comes back along a ray which meets a given triangle (an answer of cast_ray or of the
/// rasteriser). Textures are functions of place, averaged over the sample's footprint: octaves of
/// noise finer than the footprint are left out, and up to 16 places along its long side are taken.
Radiance shade_hit(const SynthWorld& world, int frame, const ViewRay& ray, const WorldHit& hit);

/// Light of the sky, clouds and far hills in a direction.
Radiance shade_sky(const SynthWorld& world, const Eigen::Vector3d& direction);

}  // namespace camber
