#include "camber/tiles/raster_tile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/markup.h"
#include "camber/export/gdal/geotiff.h"
#include "camber/export/site_bands.h"
#include "camber/export/site_points.h"
#include "camber/tiles/tile_points.h"

namespace fs = std::filesystem;

namespace camber {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;

namespace {

constexpr double kMostCells = 4e9;  // of a tile

bool is_ground(TileGroundFrom from, int kind) {
  return from == TileGroundFrom::kAll ? kind != 9 : is_ground_class(kind);
}

ReadOptions reading_of(int num_threads) {
  ReadOptions options;
  options.attributes = {"classification", "class_flags"};
  options.num_threads = num_threads;
  return options;
}

AlignedBox2d in_plan(const Eigen::AlignedBox3d& box) {
  return {Vector2d(box.min().head<2>()), Vector2d(box.max().head<2>())};
}

/// What a tile answers for.
AlignedBox2d square_of(const Tile& tile) {
  if (!tile.square) return in_plan(tile.bounds);
  return {Vector2d(tile.square->x0, tile.square->y0), Vector2d(tile.square->x1, tile.square->y1)};
}

AlignedBox2d grown(const AlignedBox2d& box, double by) {
  return {Vector2d(box.min().array() - by), Vector2d(box.max().array() + by)};
}

/// Which cells are a tile's.
class Owner {
 public:
  /// @param candidates  box of the places that are asked about
  Owner(const TilePlan& plan, std::size_t tile, const AlignedBox2d& candidates, double reach)
      : own_(square_of(plan.tiles[tile])) {
    const AlignedBox2d near = grown(candidates, reach);
    for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
      const AlignedBox2d square = square_of(plan.tiles[k]);
      if (k != tile && near.intersects(square)) others_.push_back({square, k < tile});
    }
  }
  bool has(const Vector2d& place) const {
    const double distance = own_.squaredExteriorDistance(place);
    return std::none_of(others_.begin(), others_.end(), [&](const Other& other) {
      const double there = other.square.squaredExteriorDistance(place);
      return there < distance || (other.before && there == distance);
    });
  }

 private:
  struct Other {
    AlignedBox2d square;
    bool before;
  };
  AlignedBox2d own_;
  std::vector<Other> others_;
};

/// The cells that hold places of a box.
CellWindow cells_of(const AlignedBox2d& box, double cell) {
  const auto index = [&](double v) { return static_cast<std::int64_t>(std::floor(v / cell)); };
  CellWindow out;
  out.column = index(box.min().x());
  out.columns = index(box.max().x()) + 1 - out.column;
  out.row = -(index(box.max().y()) + 1);
  out.rows = -index(box.min().y()) - out.row;
  return out;
}

SiteGrid grid_of(const CellWindow& window, double cell) {
  SiteGrid grid;
  grid.cell = cell;
  grid.west = static_cast<double>(window.column) * cell;
  grid.north = -static_cast<double>(window.row) * cell;
  grid.columns = static_cast<std::size_t>(window.columns);
  grid.rows = static_cast<std::size_t>(window.rows);
  return grid;
}

}  // namespace

RasterPlan decide_raster(const TilePlan& plan, const TileFiles& files, TileGroundFrom from,
                         double cell, double fill_holes, int num_threads) {
  constexpr std::size_t kMostSamples = 5;
  SiteSpacing spacing(plan.metres);
  for (const std::size_t tile : sample_tiles(plan, kMostSamples)) {
    const auto source = open_point_source(files(tile), reading_of(num_threads));
    for_each_site_point(*source, [&](const SitePoint& point) {
      if (is_ground(from, point.kind)) spacing.add(point.place);
    });
  }
  const double apart = spacing.spacing();
  if (!(apart > 0.0)) {
    throw NoAnswerError(plan.folder.string() + ": found no point of the ground in sample tiles");
  }
  RasterPlan out;
  out.cell = cell > 0.0 ? cell / plan.metres : site_cell(apart);
  out.reach = site_reach(out.cell, apart, fill_holes / plan.metres);
  return out;
}

TileRaster make_tile_raster(const TilePlan& plan, std::size_t tile, const TileFiles& files,
                            TileGroundFrom from, const RasterPlan& raster, int num_threads) {
  const double cell = raster.cell;
  SiteRasterOptions options;
  options.reach = raster.reach;
  options.height_per_length = plan.height_metres / plan.metres;
  options.num_threads = num_threads;
  // As far as ground is seen from the tile, and no farther than there are points.
  const AlignedBox2d all = in_plan(plan.bounds);
  AlignedBox2d box = grown(square_of(plan.tiles.at(tile)), raster.reach + cell).intersection(all);
  if (box.isEmpty()) box = in_plan(plan.tiles[tile].bounds);
  const CellWindow candidates = cells_of(box, cell);
  const double count =
      static_cast<double>(candidates.columns) * static_cast<double>(candidates.rows);
  if (!(count <= kMostCells)) {
    throw NoAnswerError(fmt::format(
        "{}: {} x {} cells of {:g} are too many for a tile; larger cells (--step) give fewer",
        plan.path_of(tile).string(), candidates.columns, candidates.rows, cell));
  }
  const SiteGrid looked_at = grid_of(candidates, cell);
  const Owner owner(plan, tile, grown(box, cell), raster.reach + 2.0 * cell);
  std::vector<char> own(looked_at.rows * looked_at.columns, 0);
  std::size_t top = looked_at.rows, bottom = 0, left = looked_at.columns, right = 0;
  TileRaster out;
  for (std::size_t row = 0; row < looked_at.rows; ++row) {
    for (std::size_t column = 0; column < looked_at.columns; ++column) {
      if (!owner.has(looked_at.center(row, column))) continue;
      own[row * looked_at.columns + column] = 1;
      ++out.cells;
      top = std::min(top, row);
      bottom = row;
      left = std::min(left, column);
      right = std::max(right, column);
    }
  }
  // A tile that lies within others has none: one cell, which is not known.
  if (out.cells == 0) top = left = 0;
  const SiteWindow window{top, left, bottom + 1 - top, right + 1 - left};
  out.window = {candidates.column + static_cast<std::int64_t>(left),
                candidates.row + static_cast<std::int64_t>(top),
                static_cast<std::int64_t>(window.columns), static_cast<std::int64_t>(window.rows)};

  const auto margin = static_cast<std::int64_t>(SiteRowsMaker::margin(cell, options));
  const SiteGrid grid = grid_of({out.window.column - margin, out.window.row - margin,
                                 out.window.columns + 2 * margin, out.window.rows + 2 * margin},
                                cell);
  const auto beside = static_cast<std::size_t>(margin);
  SiteRowsMaker maker(grid, {beside, beside, window.rows, window.columns}, options);
  const AlignedBox2d reads(
      Vector2d(grid.west, grid.north - static_cast<double>(grid.rows) * cell),
      Vector2d(grid.west + static_cast<double>(grid.columns) * cell, grid.north));
  for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
    if (!reads.intersects(in_plan(plan.tiles[k].bounds))) continue;
    const auto source = open_tile_within(plan, k, files(k), reads, reading_of(num_threads));
    if (!source) continue;
    out.read_points += for_each_site_point(*source, [&](const SitePoint& point) {
      maker.add(point.place, is_ground(from, point.kind));
    });
  }
  out.rows = maker.finish();
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t row = 0; row < window.rows; ++row) {
    for (std::size_t column = 0; column < window.columns; ++column) {
      const std::size_t at = row * window.columns + column;
      if (own[(top + row) * looked_at.columns + left + column]) {
        out.known += std::isnan(out.rows.ground[at]) ? 0 : 1;
        continue;
      }
      for (std::vector<float>* band : {&out.rows.ground, &out.rows.surface, &out.rows.slopes,
                                       &out.rows.sigmas, &out.rows.points, &out.rows.shades}) {
        (*band)[at] = kNone;
      }
    }
  }
  return out;
}

std::string raster_mosaic(const std::vector<std::string>& files,
                          const std::vector<CellWindow>& windows, const RasterPlan& raster,
                          const std::string& crs, const std::string& height_unit,
                          const std::map<std::string, std::string>& metadata) {
  if (files.size() != windows.size() || files.empty()) {
    throw std::invalid_argument(
        fmt::format("raster_mosaic: {} files and {} windows, expected one "
                    "window a file, and at least one",
                    files.size(), windows.size()));
  }
  std::int64_t west = windows[0].column, north = windows[0].row, east = west, south = north;
  for (const CellWindow& window : windows) {
    west = std::min(west, window.column);
    north = std::min(north, window.row);
    east = std::max(east, window.column + window.columns);
    south = std::max(south, window.row + window.rows);
  }
  constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
  if (east - west > kMost || south - north > kMost) {
    throw NoAnswerError(
        fmt::format("{} x {} cells are too many for one raster; larger cells (--step) give fewer",
                    east - west, south - north));
  }
  const SiteGrid grid = grid_of({west, north, east - west, south - north}, raster.cell);
  std::string text =
      fmt::format("<VRTDataset rasterXSize=\"{}\" rasterYSize=\"{}\">\n", grid.columns, grid.rows);
  if (!crs.empty()) text += "  <SRS>" + escaped_markup(crs) + "</SRS>\n";
  text += fmt::format("  <GeoTransform>{:.17g}, {:.17g}, 0, {:.17g}, 0, {:.17g}</GeoTransform>\n",
                      grid.west, grid.cell, grid.north, -grid.cell);
  text += "  <Metadata>\n";
  for (const auto& [name, value] : metadata) {
    text +=
        fmt::format("    <MDI key=\"{}\">{}</MDI>\n", escaped_markup(name), escaped_markup(value));
  }
  text += "  </Metadata>\n";
  const std::vector<RasterBand> bands = site_bands(height_unit);
  for (std::size_t b = 0; b < bands.size(); ++b) {
    text += fmt::format(
        "  <VRTRasterBand dataType=\"Float32\" band=\"{}\">\n"
        "    <Description>{}</Description>\n    <NoDataValue>{}</NoDataValue>\n",
        b + 1, escaped_markup(bands[b].name), kGeoTiffNoData);
    if (!bands[b].unit.empty()) {
      text += "    <UnitType>" + escaped_markup(bands[b].unit) + "</UnitType>\n";
    }
    for (std::size_t k = 0; k < files.size(); ++k) {
      const CellWindow& window = windows[k];
      const std::string size =
          fmt::format("xSize=\"{}\" ySize=\"{}\"", window.columns, window.rows);
      text += fmt::format(
          "    <ComplexSource>\n"
          "      <SourceFilename relativeToVRT=\"1\">{}</SourceFilename>\n"
          "      <SourceBand>{}</SourceBand>\n"
          "      <SourceProperties RasterXSize=\"{}\" RasterYSize=\"{}\" DataType=\"Float32\" "
          "BlockXSize=\"512\" BlockYSize=\"512\"/>\n"
          "      <SrcRect xOff=\"0\" yOff=\"0\" {}/>\n"
          "      <DstRect xOff=\"{}\" yOff=\"{}\" {}/>\n"
          "      <NODATA>{}</NODATA>\n"
          "    </ComplexSource>\n",
          escaped_markup(files[k]), b + 1, window.columns, window.rows, size, window.column - west,
          window.row - north, size, kGeoTiffNoData);
    }
    text += "  </VRTRasterBand>\n";
  }
  return text + "</VRTDataset>\n";
}

}  // namespace camber
