#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/plan_bounds.h"
#include "camber/road/segment_ground.h"
#include "camber/scene/json_value.h"

/// Clouds larger than memory as tiles: each is worked on with as many points around it as its
/// answers hang on, and answers for its own points alone.
namespace camber {

/// Points of a tile's file that can be read apart from the others.
struct TilePart {
  std::uint64_t points = 0;
  Eigen::AlignedBox2d box;  ///< of the points in plan, in the file's units
};

struct Tile {
  std::string name;            ///< differs from tile to tile; of its files, too
  std::filesystem::path file;  ///< relative to the plan's folder, or absolute
  std::uint64_t points = 0, bytes = 0;
  std::string hash;            ///< hash_file() of the file
  Eigen::AlignedBox3d bounds;  ///< of the points, in the file's units
  /// What the tile answers for, half-open, in the file's units; none of a survey's own tiles, which
  /// answer for the points of their file.
  std::optional<PlanBounds> square;
};

/// What is decided for all tiles of a cloud, and where they are: index.json of a plan's folder.
struct TilePlan {
  std::filesystem::path folder;
  bool in_place = false;  ///< the tiles are the survey's own files
  JsonValue request;      ///< inputs and options that it was made with
  std::string hash;       ///< of index.json: other plans have another one
  std::string crs;        ///< in words; empty: not known
  /// One unit of the files in metres: of x and y, and of heights.
  double metres = 1.0, height_metres = 1.0;
  double height_zero = 0.0;  ///< m, a round height among those of the points
  std::optional<GroundPlan> ground;
  std::string ground_reason;      ///< why there is none
  std::vector<int> keep_classes;  ///< whose points take no part in the search for ground
  std::uint64_t points = 0;
  Eigen::AlignedBox3d bounds;  ///< of the points, in the files' units
  std::vector<Tile> tiles;

  std::filesystem::path path_of(std::size_t tile) const;
};

/// Reads a plan that is complete. @throws InputError: missing, damaged, not complete.
TilePlan read_tile_plan(const std::filesystem::path& folder);

/// The same of one index.json, whose folder is the plan's.
TilePlan read_tile_index(const std::filesystem::path& file);

/// The parts of a tile's file; empty where they are not known. @throws InputError.
std::vector<TilePart> read_tile_parts(const TilePlan& plan, std::size_t tile);

/// At most so many of the tiles that hold at least half as many points as the middle one, spread
/// evenly over the list: by which what all tiles have in common is decided.
std::vector<std::size_t> sample_tiles(const TilePlan& plan, std::size_t most);

/// Where they stand: beside the tiles, a file each.
std::filesystem::path tile_record_path(const std::filesystem::path& folder,
                                       const std::string& name);

/// Writes index.json, atomically; sets the plan's hash. @throws OutputError
void write_tile_plan(TilePlan* plan);

/// What is written of one tile as soon as its points are known, and read again where planning goes
/// on.
struct TileRecord {
  Tile tile;
  std::vector<TilePart> parts;
};
void write_tile_record(const std::filesystem::path& folder, const TileRecord& record);
TileRecord read_tile_record(const std::filesystem::path& folder, const std::string& name);

}  // namespace camber
