#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/export/opencrg.h"

namespace camber {

/// The known nodes of an OpenCRG road as points (z up, m, origin the file's start), and the cells
/// whose four corners are known as two triangles each.
struct CrgMesh {
  RoadCloud cloud;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// @param data  its modifiers are not applied.
CrgMesh crg_mesh(const CrgData& data);

}  // namespace camber
