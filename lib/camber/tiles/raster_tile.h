#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "camber/export/site_raster.h"
#include "camber/tiles/tile_plan.h"

namespace camber {

/// What counts as ground where a tile's points are not judged anew.
enum class TileGroundFrom {
  kJob,    ///< classes 2 and 11 of the joined results of the job ground
  kClass,  ///< the same classes of the plan's own tiles
  kAll,    ///< all points of the plan's tiles but water
};

/// Where the points of a tile are read, by its number.
using TileFiles = std::function<std::filesystem::path(std::size_t)>;

/// What the rasters of all tiles have in common. Lengths in the files' units of x and y.
struct RasterPlan {
  double cell = 0.0;   ///< > 0
  double reach = 0.0;  ///< of SiteRasterOptions, > 0
};

/// A rectangle of cells; cells are counted from the zero of the coordinates.
struct CellWindow {
  std::int64_t column = 0;  ///< first one, to the east
  std::int64_t row = 0;     ///< first one, to the south: the upper border is at y = -row * cell
  std::int64_t columns = 0, rows = 0;
};

/// The raster of a tile's own cells.
struct TileRaster {
  CellWindow window;                   ///< of at least one cell
  SiteRows rows;                       ///< what is another tile's is NaN, in `points`, too
  std::uint64_t cells = 0, known = 0;  ///< own ones; those of them whose ground is known
  std::uint64_t read_points = 0;       ///< that were decoded, of all files
};

/// Cell and reach for all tiles: as they are given, else by how far apart the ground's points of at
/// most five tiles lie.
/// @param cell        m; 0: by the points
/// @param fill_holes  m, width of holes that are filled
/// @throws NoAnswerError where these tiles have no ground
RasterPlan decide_raster(const TilePlan& plan, const TileFiles& files, TileGroundFrom from,
                         double cell, double fill_holes, int num_threads);

/// The cells of a tile, as SiteRowsMaker has them of the whole cloud, bit for bit. A cell is that
/// tile's in whose square (in place: in the bounds of whose points) its centre lies, else the
/// nearest one's; of several the first one's.
/// @throws InputError, NoAnswerError
TileRaster make_tile_raster(const TilePlan& plan, std::size_t tile, const TileFiles& files,
                            TileGroundFrom from, const RasterPlan& raster, int num_threads);

/// Tiles of cells as one raster: GDAL's virtual format (VRT). Beside no tile nothing is known.
/// @param files        relative to the folder that the text is written into
/// @param crs          EPSG:n, well-known text or a PROJ string; empty: none
/// @param height_unit  of the bands
/// @param metadata     of the whole: name and value
std::string raster_mosaic(const std::vector<std::string>& files,
                          const std::vector<CellWindow>& windows, const RasterPlan& raster,
                          const std::string& crs, const std::string& height_unit,
                          const std::map<std::string, std::string>& metadata);

}  // namespace camber
