#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/road/detail/patch_layers.h"

/// Patches of clouds of any size: each square of the ground's plan ("block") is segmented with a
/// margin around it and apart from the others, so that its pieces of patches hang on nothing
/// farther away. Pieces that blocks find on one plane across a border are then joined.
namespace camber::detail {

inline constexpr double kBlockSide = 128.0;  ///< m; corners are multiples of it
inline constexpr double kBlockHalo = 8.0;    ///< m around a block
/// Points of a block and its halo that are segmented: of more about so many, 50 a square metre.
inline constexpr std::size_t kMostBlockPoints = std::size_t{1} << 20;

/// What a block's own points measure. Coordinates are relative to its lower corner, at `height`.
struct PatchBlock {
  std::int64_t column = 0, row = 0;  ///< the corner in block sides
  double height = 0.0;               ///< m, zero of its heights
  std::vector<PlanePatch> pieces;    ///< `inliers`: of the block's own points
  std::vector<PatchSums> sums;       ///< of each piece, over the block's own points
  PatchBorders borders;
  /// West, east, south, north: piece, or -1, of points within 4 m of that side, which are the same
  /// and in the same order as the neighbour has.
  std::array<std::vector<std::int32_t>, 4> beside;
  double tolerance = 0.0;    ///< m that ground may leave a plane by
  double local_noise = 0.0;  ///< as in Segmentation
  std::string reason;        ///< why there are no pieces, if so
};

struct PatchBlocks {
  std::vector<PatchBlock> blocks;  ///< by row, then column
  std::vector<int> labels;         ///< by points of the cloud: piece, counted over all blocks; -1
};

/// Segments the blocks that hold points of a cloud. Coordinates are rounded to whole millimetres,
/// then to 1/1024 m, whatever the cloud's origin and the order of its points: the same points
/// around a block give the same pieces, bit for bit. @param cloud  m, z up
/// @param own  empty: all; else one a point: blocks without such points are passed over
PatchBlocks fit_patch_blocks(const RoadCloud& cloud, const std::vector<std::uint8_t>& own,
                             const RoadSurfaceOptions& options, const Progress& progress);

/// What is made of blocks: joined pieces are refitted from their summed normal equations.
struct JoinedPieces {
  std::vector<PlanePatch> patches;  ///< true coordinates; ids are 0, 1, ... by their first pieces
  PatchBorders borders;             ///< by patch
  std::vector<int> patch_of_piece;  ///< counted over all blocks; -1: too few points
  std::vector<float> noise;         ///< m, of each patch
  double local_noise = 0.0;         ///< as in Segmentation
  std::string reason;               ///< why there are no patches, if so
};

/// Pieces of two blocks are joined where they hold the same points beside the border and one plane
/// does for both, as regions of one segmentation are: what it costs more than their own planes is
/// within chance and the tolerance, for each side and each piece.
/// @param blocks  by row, then column, none twice
JoinedPieces join_patch_blocks(const std::vector<PatchBlock>& blocks,
                               const RoadSurfaceOptions& options);

/// Sets the patches' unmodelled_sigma from what their pieces have, and by how far these lie off the
/// patches' planes.
void measure_unmodelled(const std::vector<PatchBlock>& blocks,
                        const std::vector<int>& patch_of_piece, RoadSurface* surface);

/// The surface of joined blocks: links, kinds and the consistency graph of all patches at once. No
/// labels. @param patch_of_piece  out, as in JoinedPieces
RoadSurfaceFit surface_of_blocks(const std::vector<PatchBlock>& blocks,
                                 const RoadSurfaceOptions& options,
                                 std::vector<int>* patch_of_piece);

}  // namespace camber::detail
