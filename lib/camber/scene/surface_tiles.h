#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/road/road_surface.h"

/// The surface of a large survey as a file a tile, FOLDER/surface/NAME.json, so that a place, a
/// line or a window of it is looked at without the rest.
namespace camber {

/// What a tile's patches are called by, and where they lie.
struct SurfaceTileSquare {
  std::string name;
  Eigen::AlignedBox2d square;  ///< m, in the surface's frame
};

/// A file of a surface in tiles.
struct SurfaceTile {
  std::filesystem::path file;
  std::size_t patches = 0;
  Eigen::AlignedBox2d bounds;           ///< m, of the outlines of its patches
  std::array<double, 2> heights{0, 0};  ///< m, lowest and highest middle of a patch
};

/// Writes FOLDER/surface: each patch into the file of the tile that its middle lies in, beside all
/// of them the nearest one's, and each link into that of its first patch; index.json last. Files of
/// tiles without patches are left out.
/// @param surface  z up, ids ascending  @param tiles  at least one; names differ
/// @throws std::invalid_argument, OutputError
void write_surface_tiles(const RoadSurface& surface, const std::vector<SurfaceTileSquare>& tiles,
                         const std::filesystem::path& folder);

/// Whether a folder has what write_surface_tiles() writes.
bool has_surface_tiles(const std::filesystem::path& folder);

/// The files of a surface in tiles. @throws InputError
std::vector<SurfaceTile> read_surface_tiles(const std::filesystem::path& folder);

/// The patches whose outlines reach into a box, with the links between them, from the files that
/// the box meets: what the whole surface has there, in its order. None: no patches.
/// @param box  m, in plan  @throws InputError
RoadSurface read_surface_within(const std::filesystem::path& folder,
                                const Eigen::AlignedBox2d& box);

}  // namespace camber
