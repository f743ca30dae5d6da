#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "camber/synth/detail/mesh_builder.h"

namespace camber {

/// A tree of 5 to 8 m times `size` on a foot; `far`: fewer and larger leaves.
void plant_tree(const Eigen::Vector3d& foot, double size, bool far, std::uint32_t seed,
                MeshBuilder* builder);
/// A bush of about 1.2 m times `size`.
void plant_bush(const Eigen::Vector3d& foot, double size, bool far, std::uint32_t seed,
                MeshBuilder* builder);

}  // namespace camber
