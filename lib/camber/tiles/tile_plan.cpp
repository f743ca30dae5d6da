#include "camber/tiles/tile_plan.h"

#include <algorithm>
#include <set>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/read_file.h"
#include "camber/scene/json_reader.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

constexpr double kMost = 1e15;         // of coordinates
constexpr double kMostCount = 9.0e15;  // whole numbers that a double holds
constexpr std::size_t kMostTiles = 5000000;

json box_json(const Eigen::AlignedBox3d& box) {
  return {{"min", vector_json(box.min())}, {"max", vector_json(box.max())}};
}

json tile_json(const Tile& tile) {
  json out = {{"name", tile.name},     {"file", tile.file.generic_string()},
              {"points", tile.points}, {"bytes", tile.bytes},
              {"hash", tile.hash},     {"bounds", box_json(tile.bounds)}};
  if (tile.square) {
    out["square"] = {tile.square->x0, tile.square->y0, tile.square->x1, tile.square->y1};
  }
  return out;
}

std::uint64_t count_of(const JsonCursor& cursor) {
  const double value = cursor.in_range(0.0, kMostCount, "a whole number of at least 0");
  if (value != std::floor(value)) cursor.fail("a whole number of at least 0");
  return static_cast<std::uint64_t>(value);
}

double coordinate_of(const JsonCursor& cursor) {
  return cursor.in_range(-kMost, kMost, "a coordinate within 1e15 of 0");
}

Eigen::AlignedBox3d read_box(const JsonCursor& cursor) {
  JsonObject object(cursor, "bounds {\"min\", \"max\"}");
  Eigen::AlignedBox3d box(object.require("min", "the least coordinates [x, y, z]").vector3(),
                          object.require("max", "the greatest coordinates [x, y, z]").vector3());
  if (!((box.min().array() <= box.max().array()).all() && box.min().cwiseAbs().maxCoeff() < kMost &&
        box.max().cwiseAbs().maxCoeff() < kMost)) {
    cursor.fail("min of at most max, both within 1e15 of 0");
  }
  object.note_unknown_keys();
  return box;
}

Tile read_tile(const JsonCursor& cursor) {
  JsonObject object(cursor, "a tile {\"name\", \"file\", ...}");
  Tile tile;
  const JsonCursor name = object.require("name", "a tile's name");
  tile.name = name.text("a tile's name");
  if (tile.name.empty() || fs::path(tile.name).filename() != tile.name || tile.name[0] == '.') {
    name.fail("a name of a file, without folders");
  }
  tile.file = object.require("file", "the path of its points").file_path();
  tile.points = count_of(object.require("points", "the number of its points"));
  tile.bytes = count_of(object.require("bytes", "the size of its file"));
  tile.hash = object.require("hash", "the hash of its file").text();
  tile.bounds = read_box(object.require("bounds", "the bounds of its points"));
  if (const auto square = object.find("square")) {
    const std::vector<double> v = square->numbers(4, "4 numbers [x0, y0, x1, y1]");
    if (!(v[0] < v[2] && v[1] < v[3])) square->fail("x0 < x1 and y0 < y1");
    tile.square = PlanBounds{v[0], v[1], v[2], v[3]};
  }
  object.note_unknown_keys();
  return tile;
}

json ground_json(const GroundPlan& ground) {
  return {{"from_air", ground.from_air},
          {"cell", ground.cell},
          {"largest_object", ground.largest_object},
          {"slope", ground.slope},
          {"tolerance", ground.tolerance},
          {"foot_tolerance", ground.foot_tolerance}};
}

GroundPlan read_ground(const JsonCursor& cursor) {
  JsonObject object(cursor, "{\"from_air\", \"cell\", ...}");
  GroundPlan out;
  out.from_air = object.require("from_air", "true or false").boolean();
  const auto number = [&](const char* key) { return object.require(key, "a number").positive(); };
  out.cell = number("cell");
  out.largest_object = number("largest_object");
  out.slope = number("slope");
  out.tolerance = number("tolerance");
  out.foot_tolerance = number("foot_tolerance");
  object.note_unknown_keys();
  try {
    out.validate();
  } catch (const std::invalid_argument& error) {
    cursor.fail_because(error.what());
  }
  return out;
}

double unit_of(const JsonCursor& cursor) {
  return cursor.in_range(1e-6, 1e6, "a unit of 1e-6 to 1e6 m");
}

}  // namespace

fs::path TilePlan::path_of(std::size_t tile) const { return folder / tiles[tile].file; }

TilePlan read_tile_plan(const fs::path& folder) {
  const fs::path path = folder / "index.json";
  std::error_code ignored;
  if (!fs::exists(path, ignored)) {
    const bool begun = fs::exists(folder / ".work", ignored);
    throw InputError(folder.string(),
                     begun ? "found a plan of tiles that is not complete, expected index.json: "
                             "repeat camber tiles plan"
                           : "found no index.json, expected a folder that camber tiles plan wrote");
  }
  return read_tile_index(path);
}

TilePlan read_tile_index(const fs::path& path) {
  const std::string text = read_whole_file(path, std::size_t{4} << 30);
  const json document = parse_json(text, path.string());
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "a plan of tiles");
  const JsonCursor format = object.require("format", "\"camber-tiles\"");
  if (format.text() != "camber-tiles") format.fail("\"camber-tiles\"");
  object.require("version", "1").integer(1, 1, "1");
  TilePlan plan;
  plan.folder = path.parent_path();
  plan.hash = hash_bytes(text);
  plan.in_place = object.require("in_place", "true or false").boolean();
  plan.request = object.require("request", "inputs and options").value();
  plan.crs = object.require("crs", "the coordinate system in words").text();
  plan.metres = unit_of(object.require("metres", "the unit of x and y, m"));
  plan.height_metres = unit_of(object.require("height_metres", "the unit of heights, m"));
  plan.height_zero = coordinate_of(object.require("height_zero", "a height, m"));
  if (const auto ground = object.find("ground")) plan.ground = read_ground(*ground);
  if (const auto reason = object.find("ground_reason")) plan.ground_reason = reason->text();
  for (const JsonCursor& kind :
       object.require("keep_classes", "ASPRS classes").items("classes from 0 to 255")) {
    plan.keep_classes.push_back(kind.integer(0, 255, "a class from 0 to 255"));
  }
  plan.points = count_of(object.require("points", "the number of points"));
  plan.bounds = read_box(object.require("bounds", "the bounds of all points"));
  const JsonCursor tiles = object.require("tiles", "a list of tiles");
  std::set<std::string> names;
  for (const JsonCursor& cursor : tiles.items("a list of tiles")) {
    plan.tiles.push_back(read_tile(cursor));
    if (!names.insert(plan.tiles.back().name).second) cursor.fail("tiles of different names");
  }
  if (plan.tiles.empty() || plan.tiles.size() > kMostTiles) tiles.fail("1 to 5,000,000 tiles");
  return plan;
}

void write_tile_plan(TilePlan* plan) {
  json tiles = json::array();
  for (const Tile& tile : plan->tiles) tiles.push_back(tile_json(tile));
  json out = {{"format", "camber-tiles"},
              {"version", 1},
              {"in_place", plan->in_place},
              {"request", *plan->request},
              {"crs", plan->crs},
              {"metres", plan->metres},
              {"height_metres", plan->height_metres},
              {"height_zero", plan->height_zero},
              {"ground", plan->ground ? ground_json(*plan->ground) : json(nullptr)},
              {"keep_classes", plan->keep_classes},
              {"points", plan->points},
              {"bounds", box_json(plan->bounds)},
              {"tiles", tiles}};
  if (!plan->ground) out["ground_reason"] = plan->ground_reason;
  const std::string text = format_json(out);
  write_file_atomically(plan->folder / "index.json", text);
  plan->hash = hash_bytes(text);
}

fs::path tile_record_path(const fs::path& folder, const std::string& name) {
  return folder / "tiles" / (name + ".json");
}

void write_tile_record(const fs::path& folder, const TileRecord& record) {
  json out = tile_json(record.tile);
  json parts = json::array();
  for (const TilePart& part : record.parts) {
    parts.push_back({part.points, part.box.min().x(), part.box.min().y(), part.box.max().x(),
                     part.box.max().y()});
  }
  out["parts"] = parts;
  write_file_atomically(tile_record_path(folder, record.tile.name), format_json(out));
}

TileRecord read_tile_record(const fs::path& folder, const std::string& name) {
  const fs::path path = tile_record_path(folder, name);
  json document = parse_json(read_whole_file(path), path.string());
  JsonContext context{path.string(), {}};
  TileRecord out;
  if (!document.is_object() || document.count("parts") == 0) {
    JsonCursor(document, context).fail("a tile {\"name\", ..., \"parts\"}");
  }
  const json parts = document["parts"];
  document.erase("parts");
  out.tile = read_tile(JsonCursor(document, context));
  for (const JsonCursor& cursor :
       JsonCursor(parts, context, "parts").items("parts [points, x0, y0, x1, y1]")) {
    const std::vector<double> v = cursor.numbers(5, "5 numbers [points, x0, y0, x1, y1]");
    if (!(v[0] >= 0.0 && v[0] <= kMostCount)) cursor.fail("a number of points of at least 0");
    TilePart part;
    part.points = static_cast<std::uint64_t>(v[0]);
    part.box.min() = {v[1], v[2]};
    part.box.max() = {v[3], v[4]};
    out.parts.push_back(part);
  }
  return out;
}

std::vector<TilePart> read_tile_parts(const TilePlan& plan, std::size_t tile) {
  return read_tile_record(plan.folder, plan.tiles[tile].name).parts;
}

std::vector<std::size_t> sample_tiles(const TilePlan& plan, std::size_t most) {
  std::vector<double> counts;
  for (const Tile& tile : plan.tiles) counts.push_back(static_cast<double>(tile.points));
  std::vector<double> sorted = counts;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(counts.size() / 2),
                   sorted.end());
  const double least = 0.5 * sorted[counts.size() / 2];
  std::vector<std::size_t> full, out;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    if (counts[k] >= least) full.push_back(k);
  }
  const std::size_t wanted = std::min(most, full.size());
  for (std::size_t k = 0; k < wanted; ++k)
    out.push_back(full[(2 * k + 1) * full.size() / (2 * wanted)]);
  return out;
}

}  // namespace camber
