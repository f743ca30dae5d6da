#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/progress.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

struct TilePlanOptions {
  double side = 0.0;                       ///< m, of a tile; 0: for about 1e7 points a tile
  std::array<double, 2> origin{0.0, 0.0};  ///< a corner of tiles, in the files' units
  bool in_place = false;                   ///< the inputs are the tiles, and stay where they are
  std::optional<CoordinateSystem> crs;     ///< in place of what the files state
  /// One unit of the files in metres: of x and y, and of heights.
  double metres = 1.0, height_metres = 1.0;
  /// Cell, largest object, slope and tolerance that are given; the others are decided by samples.
  GroundOptions ground;
  std::vector<int> keep_classes{7, 9, 17, 18};
  std::size_t memory = std::size_t{256} << 20;  ///< bytes of points that wait for their tiles
  bool overwrite =
      false;            ///< a plan with other inputs or options is replaced, with all its results
  int num_threads = 0;  ///< <= 0: see resolve_num_threads

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The units of a file's coordinates, looked up where it names its system by a code.
/// @throws NoAnswerError for longitudes and latitudes
void take_units_of(const std::filesystem::path& file, const FindSystem& find, const LogSink& warn,
                   TilePlanOptions* options);

/// Sorts the points of LAS and LAZ files into tiles (or, in place, takes the files for tiles) and
/// decides what all tiles must have in common. Reads the points once; memory is that of `memory`
/// and of one tile, the disk holds all points uncompressed in between. A plan that was interrupted
/// goes on where it was; a plan that is complete, of the same inputs and options, stays as it is.
/// Within a tile's file points are in Morton order in plan, equal places by their records, so that
/// the files depend neither on threads nor on interruptions.
/// @param folder  made where it is not there
/// @throws InputError for files that are missing, damaged or do not fit each other, UsageError for
///         a folder with another plan, NoAnswerError, OutputError also where the disk is too small.
TilePlan plan_tiles(const std::vector<std::filesystem::path>& inputs,
                    const std::filesystem::path& folder, const TilePlanOptions& options,
                    const Progress& progress = {}, const LogSink& warn = {});

}  // namespace camber
