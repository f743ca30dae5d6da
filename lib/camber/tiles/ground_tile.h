#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "camber/road/segment_ground.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

namespace detail {
class KeptParts;
}

/// The ground of a tile's own points.
struct TileGround {
  std::vector<int> labels;  ///< by their numbers in the file: 1 ground, 0 not, -1 not asked about
  std::uint64_t ground = 0, judged = 0;
  std::uint64_t read_points = 0;  ///< that were decoded, of all files
};

/// Which points of a tile are ground by the plan, with as many points around them as its reach asks
/// for: the labels are those of the whole cloud. Points of the plan's keep_classes and withheld
/// ones take no part. The same for any number of threads.
/// @param kept  as of TileReading
/// @throws InputError; NoAnswerError where the plan has no ground
TileGround segment_tile_ground(const TilePlan& plan, std::size_t tile, int num_threads,
                               detail::KeptParts* kept = nullptr);

/// The same of a whole file, undivided.
TileGround segment_whole_ground(const TilePlan& plan, const std::filesystem::path& file,
                                int num_threads);

/// Decides kind, cell and tolerances of the ground for all tiles: by at most five of those that
/// hold many points, each with a margin around it, the kind by majority, the others by their
/// medians. Sets the plan's `ground`, or `ground_reason`.
/// @param given  cell, largest object, slope and tolerance that are not 0 are taken as they are
void decide_ground(TilePlan* plan, const GroundOptions& given);

}  // namespace camber
