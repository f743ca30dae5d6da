#include "camber/tiles/patch_tile.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/road/detail/patch_blocks.h"
#include "camber/tiles/detail/patch_file.h"
#include "camber/tiles/tile_points.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr std::size_t kMostBytes = std::size_t{64} << 30;

detail::TilePatches read_pieces(const fs::path& file) {
  return detail::decode_patches(read_whole_file(file, kMostBytes), file.string());
}

}  // namespace

TilePieces find_tile_pieces(const TilePlan& plan, std::size_t tile,
                            const RoadSurfaceOptions& options, detail::KeptParts* kept) {
  constexpr double kRounding = 0.01;  // m
  TileReading reading;
  reading.halo = detail::kBlockHalo + kRounding;
  reading.alignment = detail::kBlockSide;
  reading.whole_squares = true;
  reading.num_threads = options.num_threads;
  reading.kept = kept;
  TilePoints points = read_tile_points(plan, tile, reading);
  throw_if_interrupted();
  std::vector<std::uint8_t> own;
  own.reserve(points.own.size());
  for (const std::int32_t number : points.own) own.push_back(number >= 0 ? 1 : 0);
  detail::PatchBlocks found = detail::fit_patch_blocks(points.cloud, own, options, {});
  TilePieces out;
  out.read_points = points.read_points;
  detail::TilePatches pieces;
  pieces.blocks = std::move(found.blocks);
  pieces.labels.assign(static_cast<std::size_t>(points.own_points), -1);
  for (std::size_t i = 0; i < points.own.size(); ++i) {
    if (points.own[i] < 0) continue;
    pieces.labels[static_cast<std::size_t>(points.own[i])] = found.labels[i];
    out.on_pieces += found.labels[i] >= 0 ? 1 : 0;
  }
  for (const detail::PatchBlock& block : pieces.blocks) out.pieces += block.pieces.size();
  out.bytes = detail::encode_patches(pieces);
  return out;
}

JoinedPatches join_tile_patches(const std::vector<fs::path>& files,
                                const RoadSurfaceOptions& options) {
  struct Known {
    detail::PatchBlock block;
    std::string hash;
    const fs::path* file = nullptr;
  };
  std::map<std::pair<std::int64_t, std::int64_t>, Known> all;
  for (const fs::path& file : files) {
    throw_if_interrupted();
    detail::TilePatches tile = read_pieces(file);
    for (detail::PatchBlock& block : tile.blocks) {
      detail::TilePatches alone;
      alone.blocks.push_back(std::move(block));
      // A block on a border is in several tiles, from the same points.
      std::string hash = hash_bytes(detail::encode_patches(alone));
      detail::PatchBlock& own = alone.blocks.front();
      const auto place = std::make_pair(own.row, own.column);
      const auto found = all.find(place);
      if (found == all.end()) {
        all[place] = {std::move(own), std::move(hash), &file};
      } else if (found->second.hash != hash) {
        throw InputError(file.string(),
                         fmt::format("found other pieces of the square {} {} than in {}; repeat "
                                     "tiles run with one version of the program",
                                     place.second, place.first, found->second.file->string()));
      }
    }
  }
  JoinedPatches out;
  std::vector<detail::PatchBlock> blocks;
  for (auto& [place, known] : all) blocks.push_back(std::move(known.block));
  all.clear();
  std::vector<int> patch_of_piece;
  out.fit = detail::surface_of_blocks(blocks, options, &patch_of_piece);
  detail::PieceIds ids;
  auto next = patch_of_piece.begin();
  for (const detail::PatchBlock& block : blocks) {
    const auto end = next + static_cast<std::ptrdiff_t>(block.pieces.size());
    ids.blocks.push_back({block.row, block.column, {next, end}});
    next = end;
  }
  out.ids = detail::encode_ids(ids);
  out.blocks = blocks.size();
  out.pieces = patch_of_piece.size();
  return out;
}

std::vector<int> tile_patch_labels(const fs::path& pieces, const fs::path& ids) {
  const detail::TilePatches tile = read_pieces(pieces);
  const detail::PieceIds known = detail::decode_ids(read_whole_file(ids, kMostBytes), ids.string());
  std::vector<int> patch_of;
  for (const detail::PatchBlock& block : tile.blocks) {
    const auto place = std::make_pair(block.row, block.column);
    const auto found = std::lower_bound(
        known.blocks.begin(), known.blocks.end(), place,
        [](const auto& l, const auto& r) { return std::make_pair(l.row, l.column) < r; });
    if (found == known.blocks.end() || std::make_pair(found->row, found->column) != place ||
        found->ids.size() != block.pieces.size()) {
      throw InputError(ids.string(),
                       fmt::format("found no patches of the square {} {} as in {}; repeat tiles "
                                   "join",
                                   block.column, block.row, pieces.string()));
    }
    patch_of.insert(patch_of.end(), found->ids.begin(), found->ids.end());
  }
  std::vector<int> out;
  out.reserve(tile.labels.size());
  for (const std::int32_t label : tile.labels) {
    out.push_back(label < 0 ? -1 : patch_of[static_cast<std::size_t>(label)]);
  }
  return out;
}

}  // namespace camber
