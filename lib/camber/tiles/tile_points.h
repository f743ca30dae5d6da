#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/point_stream.h"
#include "camber/cloud/road_cloud.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

namespace detail {
class KeptParts;
}

/// The points of a tile with those around it, as every tile of the plan, and the whole cloud, has
/// them: coordinates are multiples of 1/1024 m from an origin that is a multiple of the alignment,
/// and the points are in the order of y, x and height. So what is computed of a point from those
/// around it is the same in every tile that holds them, bit for bit.
struct TilePoints {
  RoadCloud cloud;                    ///< m; origin in m, of heights the plan's height_zero
  std::vector<std::int32_t> own;      ///< of each point its number in the tile's file; -1: around
  std::vector<std::uint8_t> classes;  ///< where they were asked for: ASPRS class, 0 where none
  std::vector<std::uint8_t> flags;    ///< the same of class_flags
  std::uint64_t own_points = 0;       ///< of the tile's file
  std::uint64_t read_points = 0;      ///< that were decoded, of all files
};

struct TileReading {
  double halo = 0.0;           ///< m beside the tile's points, along x and y
  double alignment = 1.0;      ///< m, a multiple of 1/1024 m
  bool whole_squares = false;  ///< halo beside the squares of the alignment that hold the points
  bool classes = false;        ///< classes and flags, too
  int num_threads = 0;         ///< <= 0: see resolve_num_threads
  /// Takes what the tile before left there, and leaves what the next one needs; the points are the
  /// same without. All its readings have the same halo, alignment and classes.
  detail::KeptParts* kept = nullptr;
};

/// Reads a tile and, of its neighbours, the parts of their files that reach into the halo.
/// @throws InputError for a file that is missing, damaged or not that of the plan; NoAnswerError
///         where the points lie too far apart for floats.
TilePoints read_tile_points(const TilePlan& plan, std::size_t tile, const TileReading& reading);

/// Of another plan all points that lie no farther than the halo beside those of a tile's, relative
/// to the same origin; `own` is -1. @param around  as read_tile_points() gives them
/// @throws as read_tile_points(); NoAnswerError where the plans' heights count from elsewhere by
/// more
///         than 16 km
TilePoints read_points_around(const TilePlan& plan, const TilePoints& around,
                              const TileReading& reading);

/// The same of a whole file, as if the plan had one tile.
TilePoints read_whole_points(const TilePlan& plan, const std::filesystem::path& file,
                             const TileReading& reading);

/// Of a tile's points those parts of a file that reach into a box, in plan and in the file's units;
/// all where they cannot be read apart. nullptr where none does.
/// @param path  the tile's own file, or one that holds its points in their order
/// @throws InputError
std::unique_ptr<PointSource> open_tile_within(const TilePlan& plan, std::size_t tile,
                                              const std::filesystem::path& path,
                                              const Eigen::AlignedBox2d& box,
                                              const ReadOptions& options);

/// The records of a tile's points with those around it, in the order that TilePoints has; equal
/// places by the records' bytes.
struct TileRecords {
  PointStreamHeader header;        ///< of the tile's file
  std::string records;             ///< one behind the other
  std::vector<int> order;          ///< of them
  std::vector<unsigned char> own;  ///< by that order: 1 of the tile, 0 around
  std::uint64_t own_points = 0;    ///< of the tile's file
  std::uint64_t read_points = 0;   ///< that were decoded, of all files
};

/// @throws also InputError where a neighbour's records are of another kind, or on another grid
TileRecords read_tile_records(const TilePlan& plan, std::size_t tile, const TileReading& reading);

}  // namespace camber
