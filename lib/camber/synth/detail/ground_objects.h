#pragma once

#include <array>
#include <cstdint>

#include "camber/synth/detail/mesh_builder.h"
#include "camber/synth/road_model.h"

namespace camber {

/// The objects of the ground's triangles, one a kind.
class GroundObjects {
 public:
  /// @param half_width  of the street, for what is laid out across it
  /// @param contrast    of the asphalt's texture
  GroundObjects(double half_width, std::uint32_t seed, float contrast, MeshBuilder* builder);

  int of(GroundKind kind) const { return objects_[static_cast<std::size_t>(kind)]; }

 private:
  std::array<int, 5> objects_{};
};

/// Asphalt of a street; extent: half width (m), contrast, 1 where it has markings and wheel tracks.
SynthObject asphalt_object(double half_width, float contrast, bool marked, std::uint32_t seed);

}  // namespace camber
