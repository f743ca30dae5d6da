#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// Which triangle is seen at each sample of a grid `supersampling` times as fine as the image:
/// sample (i, j) of pixel (u, v) lies at u + (i + 0.5) / supersampling - 0.5. Off-screen by VTK; no
/// X server is needed.
struct TriangleIds {
  int width = 0, height = 0;   ///< samples: the image's times supersampling
  std::vector<WorldHit> hits;  ///< row by row; `distance` is not set; triangle -1: sky
};

/// @throws MachineError if no rendering back end answers.
TriangleIds rasterise_triangle_ids(const SynthWorld& world, int frame, const PinholeCamera& camera,
                                   int supersampling);

}  // namespace camber
