#include "camber/scene/surface_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"
#include "camber/scene/surface_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;
using nlohmann::json;

fs::path index_path(const fs::path& folder) { return folder / "surface" / "index.json"; }

AlignedBox2d outline_box(const PlanePatch& patch) {
  AlignedBox2d box;
  for (const Eigen::Vector3d& corner : patch.boundary) box.extend(Vector2d(corner.head<2>()));
  if (box.isEmpty()) box.extend(Vector2d(patch.plane.centroid.head<2>()));
  return box;
}

/// Which tile a place lies in, by a grid of cells as wide as the widest tile.
class TileLookup {
 public:
  explicit TileLookup(const std::vector<SurfaceTileSquare>& tiles) : tiles_(tiles) {
    for (const SurfaceTileSquare& tile : tiles) {
      cell_ = std::max(cell_, tile.square.sizes().maxCoeff());
    }
    for (std::size_t k = 0; k < tiles.size(); ++k) {
      const auto low = cell_of(tiles[k].square.min()), high = cell_of(tiles[k].square.max());
      for (std::int64_t y = low.second; y <= high.second; ++y) {
        for (std::int64_t x = low.first; x <= high.first; ++x) cells_[{x, y}].push_back(k);
      }
    }
  }

  std::size_t tile_of(const Vector2d& place) const {
    const auto found = cells_.find(cell_of(place));
    if (found != cells_.end()) {
      for (const std::size_t k : found->second) {
        const AlignedBox2d& square = tiles_[k].square;
        if ((place.array() >= square.min().array()).all() &&
            (place.array() < square.max().array()).all()) {
          return k;
        }
      }
    }
    std::size_t nearest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < tiles_.size(); ++k) {
      const double distance = tiles_[k].square.squaredExteriorDistance(place);
      if (distance < least) {
        least = distance;
        nearest = k;
      }
    }
    return nearest;
  }

 private:
  using Cell = std::pair<std::int64_t, std::int64_t>;
  Cell cell_of(const Vector2d& place) const {
    return {static_cast<std::int64_t>(std::floor(place.x() / cell_)),
            static_cast<std::int64_t>(std::floor(place.y() / cell_))};
  }

  const std::vector<SurfaceTileSquare>& tiles_;
  double cell_ = 1.0;
  std::map<Cell, std::vector<std::size_t>> cells_;
};

}  // namespace

void write_surface_tiles(const RoadSurface& surface, const std::vector<SurfaceTileSquare>& tiles,
                         const fs::path& folder) {
  if (tiles.empty()) throw std::invalid_argument("tiles: found none, expected at least one");
  const TileLookup lookup(tiles);
  std::vector<std::vector<std::size_t>> patches(tiles.size()), links(tiles.size());
  std::map<int, std::size_t> tile_of_patch;
  for (std::size_t i = 0; i < surface.patches.size(); ++i) {
    const std::size_t tile = lookup.tile_of(surface.patches[i].plane.centroid.head<2>());
    patches[tile].push_back(i);
    tile_of_patch[surface.patches[i].id] = tile;
  }
  for (std::size_t i = 0; i < surface.links.size(); ++i) {
    const auto tile = tile_of_patch.find(surface.links[i].a);
    if (tile != tile_of_patch.end()) links[tile->second].push_back(i);
  }
  const fs::path index = index_path(folder);
  std::error_code error;
  fs::remove_all(index.parent_path(), error);  // also tiles of another plan
  if (!error) fs::create_directories(index.parent_path(), error);
  if (error) throw OutputError(index.parent_path().string(), error.message());
  json entries = json::array();
  RoadSurface part = without_contents(surface);
  part.driven_line.clear();
  for (std::size_t k = 0; k < tiles.size(); ++k) {
    if (patches[k].empty()) continue;
    throw_if_interrupted();
    part.patches.clear();
    part.links.clear();
    AlignedBox2d bounds;
    std::array<double, 2> heights{std::numeric_limits<double>::infinity(),
                                  -std::numeric_limits<double>::infinity()};
    for (const std::size_t i : patches[k]) {
      const PlanePatch& patch = surface.patches[i];
      part.patches.push_back(patch);
      bounds.extend(outline_box(patch));
      heights[0] = std::min(heights[0], patch.plane.centroid.z());
      heights[1] = std::max(heights[1], patch.plane.centroid.z());
    }
    for (const std::size_t i : links[k]) part.links.push_back(surface.links[i]);
    const std::string file = tiles[k].name + ".json";
    write_surface(part, index.parent_path() / file);
    entries.push_back(
        {{"file", file},
         {"patches", part.patches.size()},
         {"bounds", {bounds.min().x(), bounds.min().y(), bounds.max().x(), bounds.max().y()}},
         {"heights", heights}});
  }
  json document = to_json(without_contents(surface));
  document["format"] = "camber-surface-tiles";
  document["tiles"] = std::move(entries);
  write_json(document, index);
}

bool has_surface_tiles(const fs::path& folder) {
  std::error_code error;
  return fs::is_regular_file(index_path(folder), error);
}

std::vector<SurfaceTile> read_surface_tiles(const fs::path& folder) {
  const fs::path path = index_path(folder);
  const json document = parse_json(read_whole_file(path, std::size_t{4} << 30), path.string());
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "a surface in tiles");
  const JsonCursor format = object.require("format", "\"camber-surface-tiles\"");
  if (format.text() != "camber-surface-tiles") format.fail("\"camber-surface-tiles\"");
  std::vector<SurfaceTile> out;
  for (const JsonCursor& cursor : object.require("tiles", "tiles").items("tiles")) {
    JsonObject tile(cursor, "a tile");
    SurfaceTile one;
    one.file = path.parent_path() / tile.require("file", "the name of its file").file_path();
    one.patches = static_cast<std::size_t>(
        tile.require("patches", "a number").in_range(0.0, 2e9, "a number of patches"));
    const std::vector<double> b =
        tile.require("bounds", "4 numbers").numbers(4, "4 numbers [x0, y0, x1, y1]");
    one.bounds = AlignedBox2d(Vector2d(b[0], b[1]), Vector2d(b[2], b[3]));
    const std::vector<double> z = tile.require("heights", "2 numbers").numbers(2, "2 numbers");
    one.heights = {z[0], z[1]};
    out.push_back(std::move(one));
  }
  return out;
}

RoadSurface read_surface_within(const fs::path& folder, const AlignedBox2d& box) {
  const std::vector<SurfaceTile> tiles = read_surface_tiles(folder);
  RoadSurface out = read_surface(index_path(folder));
  std::set<int> ids;
  for (const SurfaceTile& tile : tiles) {
    if (!tile.bounds.intersects(box)) continue;
    throw_if_interrupted();
    RoadSurface part = read_surface(tile.file);
    for (PlanePatch& patch : part.patches) {
      if (!outline_box(patch).intersects(box)) continue;
      ids.insert(patch.id);
      out.patches.push_back(std::move(patch));
    }
    std::move(part.links.begin(), part.links.end(), std::back_inserter(out.links));
  }
  std::sort(out.patches.begin(), out.patches.end(),
            [](const PlanePatch& l, const PlanePatch& r) { return l.id < r.id; });
  out.links.erase(std::remove_if(out.links.begin(), out.links.end(),
                                 [&](const PatchLink& link) {
                                   return ids.count(link.a) == 0 || ids.count(link.b) == 0;
                                 }),
                  out.links.end());
  std::stable_sort(out.links.begin(), out.links.end(), [](const PatchLink& l, const PatchLink& r) {
    return std::make_pair(l.a, l.b) < std::make_pair(r.a, r.b);
  });
  return out;
}

}  // namespace camber
