#pragma once

#include <optional>
#include <string>
#include <vector>

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

/// Leaves those nodes in the file's `laz` that a query asks for, in the order of the file. The
/// index is read whole: each chunk must have an entry. Points of a node may lie outside of the
/// bounds.
/// @param lenient  what is damaged is passed over and a note says what is missing; chunks without
/// an
///                 entry are kept where bounds alone are asked for
/// @throws InputError where the index is damaged; leniently where levels are asked for and it names
///         no chunk
void select_nodes(LasFile* las, const CopcQuery& query, bool lenient,
                  std::vector<std::string>* notes);

}  // namespace camber::laz
