#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/road/fit_road_surface.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

namespace detail {
class KeptParts;
}

/// The pieces of patches of a tile's own points, as bytes for join_tile_patches().
struct TilePieces {
  std::string bytes;
  std::uint64_t pieces = 0;       ///< that hold own points
  std::uint64_t on_pieces = 0;    ///< own points that are on one
  std::uint64_t read_points = 0;  ///< that were decoded, of all files
};

/// Segments the squares of 128 m that a tile's own points lie in, each with its surroundings, as
/// fit_road_surface() does of a large cloud. The same for any number of threads.
/// @param kept  as of TileReading
/// @throws InputError, NoAnswerError
TilePieces find_tile_pieces(const TilePlan& plan, std::size_t tile,
                            const RoadSurfaceOptions& options, detail::KeptParts* kept = nullptr);

/// The surface that fit_road_surface() makes of a large undivided cloud.
struct JoinedPatches {
  RoadSurfaceFit fit;  ///< no labels
  std::string ids;     ///< bytes for tile_patch_labels()
  std::uint64_t blocks = 0, pieces = 0;
};

/// Joins the pieces of all tiles of a plan, in any order: pieces on one plane become one patch,
/// with one consistency graph. @param files  what find_tile_pieces() gave, a file each tile
/// @throws InputError for a file that is damaged, or of other points than another one
JoinedPatches join_tile_patches(const std::vector<std::filesystem::path>& files,
                                const RoadSurfaceOptions& options);

/// The patch of each of a tile's own points, by their numbers in the file; -1: none.
/// @param pieces, ids  what find_tile_pieces() and join_tile_patches() gave, as files
std::vector<int> tile_patch_labels(const std::filesystem::path& pieces,
                                   const std::filesystem::path& ids);

}  // namespace camber
