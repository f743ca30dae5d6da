#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/road/detail/patch_blocks.h"

/// What the job "patches" leaves of a tile for the join, and the join for the labels: bytes of this
/// machine's order (little-endian on all that Camber is built for).
namespace camber::detail {

struct TilePatches {
  std::vector<PatchBlock> blocks;    ///< of the tile's own points, by row, then column
  std::vector<std::int32_t> labels;  ///< by own points: piece, counted over these blocks, or -1
};

std::string encode_patches(const TilePatches& patches);
/// @param name  of the file, for messages  @throws InputError where the bytes are no such file
TilePatches decode_patches(const std::string& bytes, const std::string& name);

/// Patches of the pieces of all blocks.
struct PieceIds {
  struct Block {
    std::int64_t row = 0, column = 0;
    std::vector<std::int32_t> ids;  ///< a piece; -1: too few points
  };
  std::vector<Block> blocks;  ///< by row, then column
};

std::string encode_ids(const PieceIds& ids);
PieceIds decode_ids(const std::string& bytes, const std::string& name);

}  // namespace camber::detail
