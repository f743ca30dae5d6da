#pragma once

#include <optional>

#include "camber/cloud/las_file.h"
#include "camber/cloud/plan_bounds.h"

/// The index of COPC files: "COPC - Cloud Optimized Point Cloud, 1.0", copc.io. The points are the
/// nodes of an octree, a chunk of LAZ each.
namespace camber::laz {

inline constexpr const char* kCopcUser = "copc";  ///< of its records

struct CopcQuery {
  /// Nodes that reach into them.
  std::optional<PlanBounds> bounds;
  /// Levels down to the first whose points are no farther apart; 0: all.
  double resolution = 0.0;
};

/// Whether a file has the record of one.
bool is_copc(const LasFile& las);

/// Leaves those nodes in the file's `laz` that a query asks for, in the order of the file, reading
/// no more of the index than that takes. Points of a node may lie outside of the bounds.
/// @throws InputError where the index is damaged
void select_nodes(LasFile* las, const CopcQuery& query);

}  // namespace camber::laz
