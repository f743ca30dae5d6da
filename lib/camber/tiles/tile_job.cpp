#include "camber/tiles/tile_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/core/version.h"
#include "camber/export/site_bands.h"
#include "camber/export/site_points.h"
#include "camber/road/cloud_profile.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/surface_file.h"
#include "camber/scene/surface_tiles.h"
#include "camber/tiles/detail/kept_parts.h"
#include "camber/tiles/ground_tile.h"
#include "camber/tiles/point_tile.h"
#include "camber/tiles/tile_points.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using nlohmann::json;

constexpr const char* kPiecesSuffix = ".patches";

json done_json(const TileDone& done) {
  json out = {{"name", done.name},     {"file", done.file.generic_string()},
              {"points", done.points}, {"bytes", done.bytes},
              {"hash", done.hash},     {"points_read", done.read_points},
              {"counts", done.counts}};
  if (done.window) {
    const CellWindow& window = *done.window;
    out["window"] = {window.column, window.row, window.columns, window.rows};
  }
  return out;
}

TileDone read_done(const json& document, const fs::path& path) {
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "a tile that is done");
  const auto count = [](const JsonCursor& cursor) {
    return static_cast<std::uint64_t>(cursor.in_range(0.0, 9e15, "a number of at least 0"));
  };
  TileDone out;
  out.name = object.require("name", "a tile's name").text();
  out.file = object.require("file", "the name of its file").file_path();
  out.points = count(object.require("points", "a number"));
  out.bytes = count(object.require("bytes", "a number"));
  out.hash = object.require("hash", "the hash of its file").text();
  out.read_points = count(object.require("points_read", "a number"));
  JsonObject counts(object.require("counts", "numbers by name"), "numbers by name");
  for (const auto& [name, value] : counts.entries()) out.counts[name] = count(value);
  if (const auto window = object.find("window")) {
    const std::vector<double> v =
        window->numbers(4, "4 whole numbers [column, row, columns, rows] within 9e15 of 0");
    const auto whole = [](double n) { return n == std::floor(n) && std::abs(n) <= 9e15; };
    if (!std::all_of(v.begin(), v.end(), whole) || v[2] < 1.0 || v[3] < 1.0) {
      window->fail("4 whole numbers [column, row, columns, rows] within 9e15 of 0");
    }
    out.window = CellWindow{static_cast<std::int64_t>(v[0]), static_cast<std::int64_t>(v[1]),
                            static_cast<std::int64_t>(v[2]), static_cast<std::int64_t>(v[3])};
  }
  return out;
}

fs::path done_path(const TilePlan& plan, const TileJob& job, std::size_t tile) {
  return job_folder(plan, job) / (plan.tiles[tile].name + ".json");
}

/// Of the joined patches.
fs::path ids_path(const TilePlan& plan, const TileJob& job) {
  TileJob patches;
  patches.kind = TileJob::Kind::kPatches;
  patches.folder = job.kind == TileJob::Kind::kLabels ? job.patches : job.folder;
  return job_folder(plan, patches) / "patches.ids";
}

/// What the pieces of a tile hang on.
json surface_json(const RoadSurfaceOptions& options) {
  return {{"seed", options.seed},
          {"max_slope", options.max_slope},
          {"threshold", options.inlier_threshold},
          {"min_points", options.min_patch_points},
          {"tolerance", options.tolerance},
          {"tolerance_sigmas", options.tolerance_sigmas}};
}

void read_surface_options(const fs::path& path, RoadSurfaceOptions* options) {
  const json document = parse_json(read_whole_file(path), path.string());
  JsonContext context{path.string(), {}};
  JsonObject job(JsonCursor(document, context), "the options of a job");
  JsonObject object(job.require("surface", "options of patches"), "options of patches");
  options->seed =
      static_cast<std::uint64_t>(object.require("seed", "a number").in_range(0.0, 9e15, "a seed"));
  options->max_slope = object.require("max_slope", "a number").number();
  options->inlier_threshold = object.require("threshold", "a number").number();
  options->min_patch_points = static_cast<int>(
      object.require("min_points", "a number").in_range(3.0, 2e9, "a number of at least 3"));
  options->tolerance = object.require("tolerance", "a number").number();
  options->tolerance_sigmas = object.require("tolerance_sigmas", "a number").number();
  options->validate();
}

const char* to_string(TileGroundFrom from) {
  return from == TileGroundFrom::kClass ? "class" : from == TileGroundFrom::kAll ? "all" : "job";
}

TileGroundFrom ground_from_string(const JsonCursor& cursor) {
  const std::string name = cursor.text();
  for (const TileGroundFrom from :
       {TileGroundFrom::kJob, TileGroundFrom::kClass, TileGroundFrom::kAll}) {
    if (name == to_string(from)) return from;
  }
  cursor.fail("\"job\", \"class\" or \"all\"");
}

fs::path ground_folder(const TilePlan& plan, const TileJob& job) {
  TileJob ground;
  ground.folder = job.ground;
  return job_folder(plan, ground);
}

/// Where the classes of ground are: the hash of the joined results, or a word.
/// @throws InputError where there are none of this plan
std::string ground_hash(const TilePlan& plan, const TileJob& job) {
  if (job.ground_from != TileGroundFrom::kJob) return "";
  const fs::path path = ground_folder(plan, job) / "index.json";
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw InputError(path.string(),
                     "found no joined ground, expected camber tiles run and join --job ground "
                     "before, or classes of the survey (--ground-from class)");
  }
  const std::string text = read_whole_file(path, std::size_t{4} << 30);
  const json document = parse_json(text, path.string());
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "joined tiles");
  const JsonCursor kind = object.require("job", "\"ground\"");
  if (kind.text() != "ground") kind.fail("\"ground\"");
  const JsonCursor of = object.require("plan", "the hash of a plan");
  if (of.text() != plan.hash) of.fail("the ground of this plan: " + plan.hash);
  return hash_bytes(text);
}

/// The points of each tile with their classes.
TileFiles ground_files(const TilePlan& plan, const TileJob& job) {
  if (job.ground_from != TileGroundFrom::kJob) {
    return [&plan](std::size_t tile) { return plan.path_of(tile); };
  }
  return [&plan, folder = ground_folder(plan, job)](std::size_t tile) {
    return folder / (plan.tiles[tile].name + ".laz");
  };
}

std::string line_hash(const std::vector<Eigen::Vector3d>& line) {
  std::string text;
  for (const Eigen::Vector3d& place : line) {
    text += fmt::format("{:a} {:a}\n", place.x(), place.y());
  }
  return hash_bytes(text);
}

RasterPlan read_raster_plan(const fs::path& path) {
  const json document = parse_json(read_whole_file(path), path.string());
  JsonContext context{path.string(), {}};
  JsonObject job(JsonCursor(document, context), "the options of a job");
  JsonObject raster(job.require("raster", "cells of a raster"), "cells of a raster");
  return {raster.require("cell", "a length").positive(),
          raster.require("reach", "a length").positive()};
}

json options_json(const TilePlan& plan, const TileJob& job) {
  json out = {{"format", "camber-tile-options"},
              {"version", 1},
              {"job", to_string(job.kind)},
              {"plan", plan.hash}};
  if (job.kind == TileJob::Kind::kVoxels) out["voxel"] = job.voxel;
  if (job.kind == TileJob::Kind::kPatches) out["surface"] = surface_json(job.surface);
  if (job.kind == TileJob::Kind::kLabels) {
    out["patches"] = hash_file(ids_path(plan, job));
  }
  if (job.kind == TileJob::Kind::kCompare) {
    out["truth"] = read_tile_plan(job.truth).hash;
    out["radius"] = job.radius;
    out["thresholds"] = job.thresholds;
  }
  if (job.kind == TileJob::Kind::kFilter || job.kind == TileJob::Kind::kNormals) {
    out["radius"] = job.radius;
    out["neighbors"] = job.neighbors;
  }
  if (job.kind == TileJob::Kind::kExport || job.kind == TileJob::Kind::kProfile) {
    out["ground_from"] = to_string(job.ground_from);
    out["ground"] = ground_hash(plan, job);
  }
  if (job.kind == TileJob::Kind::kExport) {
    out["step"] = job.step;
    out["fill_holes"] = job.fill_holes;
    out["crs"] = job.crs;
    out["height_unit"] = job.height_unit;
  }
  if (job.kind == TileJob::Kind::kProfile) {
    out["line"] = line_hash(job.line);
    out["half_width"] = job.half_width;
  }
  return out;
}

/// The tile as an earlier run left it.
bool find_done(const TilePlan& plan, const TileJob& job, std::size_t tile, TileDone* done) {
  const fs::path path = done_path(plan, job, tile);
  std::error_code error;
  if (!fs::exists(path, error)) return false;
  const json document = parse_json(read_whole_file(path), path.string());
  if (!document.is_object() || document.value("plan", json()) != plan.hash) return false;
  *done = read_done(document, path);
  if (done->name != plan.tiles[tile].name) return false;
  const std::uintmax_t bytes = fs::file_size(job_folder(plan, job) / done->file, error);
  return !error && bytes == done->bytes;
}

/// The source of a tile's own points with what was found of them, and how much that is.
class Found {
 public:
  Found(const TilePlan& plan, const TileJob& job, std::size_t tile, detail::KeptParts* kept) {
    ReadOptions reading;
    reading.num_threads = job.num_threads;
    const auto open = [&] { return open_point_source(plan.path_of(tile), reading); };
    switch (job.kind) {
      case TileJob::Kind::kGround:
        ground_ = segment_tile_ground(plan, tile, job.num_threads, kept);
        read_points = ground_.read_points;
        counts = {{"ground", ground_.ground}, {"judged", ground_.judged}};
        source = classify_ground(open(), ground_.labels);
        break;
      case TileJob::Kind::kFilter:
        inliers_ = tile_radius_inliers(plan, tile, job.radius, job.neighbors, job.num_threads);
        read_points = inliers_.read_points;
        counts = {{"kept", inliers_.points}};
        source = select_rows(open(), [this](const PointStreamHeader&, const PointBatch& batch,
                                            std::vector<unsigned char>* keep) {
          for (std::size_t i = 0; i < batch.count; ++i) (*keep)[i] = inliers_.kept.at(place_++);
        });
        break;
      case TileJob::Kind::kVoxels:
        voxels_ = std::make_unique<TileVoxels>(plan, tile, job.voxel, job.num_threads);
        read_points = voxels_->read_points();
        source = voxels_->points();
        break;
      case TileJob::Kind::kNormals:
        normals_ = tile_normals(plan, tile, job.radius, job.neighbors, job.num_threads);
        read_points = normals_.read_points;
        counts = {{"normals", normals_.points}};
        source = add_normals(open(), normals_.normals);
        break;
      case TileJob::Kind::kLabels: {
        TileJob patches;
        patches.kind = TileJob::Kind::kPatches;
        patches.folder = job.patches;
        labels_ =
            tile_patch_labels(job_folder(plan, patches) / (plan.tiles[tile].name + kPiecesSuffix),
                              ids_path(plan, job));
        counts = {
            {"on_patches", static_cast<std::uint64_t>(std::count_if(
                               labels_.begin(), labels_.end(), [](int l) { return l >= 0; }))}};
        read_points = labels_.size();
        source = add_label(open(), "patch", labels_);
        break;
      }
      case TileJob::Kind::kCompare: {
        const TileDistances found =
            tile_distances(plan, tile, read_tile_plan(job.truth), job.radius, job.num_threads);
        distances_ = found.distances;
        read_points = found.read_points;
        const auto count = [&](double most) {
          return static_cast<std::uint64_t>(
              std::count_if(distances_.begin(), distances_.end(),
                            [&](float d) { return static_cast<double>(d) <= most; }));
        };
        counts = {{"compared", count(job.radius)}};
        for (const double t : job.thresholds) counts[fmt::format("within_{:g}", t)] = count(t);
        source = add_numbers(open(), "distance", distances_);
        break;
      }
      case TileJob::Kind::kProfile:
        choose_near_line(plan, job, tile, reading);
        break;
      case TileJob::Kind::kPatches:  // no points: run_tile_job()
      case TileJob::Kind::kExport:
        break;
    }
  }
  Found(const Found&) = delete;
  Found& operator=(const Found&) = delete;

  std::unique_ptr<PointSource> source;
  std::uint64_t read_points = 0;
  std::map<std::string, std::uint64_t> counts;

 private:
  void choose_near_line(const TilePlan& plan, const TileJob& job, std::size_t tile,
                        ReadOptions reading) {
    const fs::path path = ground_files(plan, job)(tile);
    corridor_ =
        std::make_unique<ProfileCorridor>(job.line, Eigen::Vector3d::UnitZ(), job.half_width);
    Eigen::AlignedBox2d box = corridor_->bounds();
    box.min() /= plan.metres;
    box.max() /= plan.metres;
    std::unique_ptr<PointSource> near = open_tile_within(plan, tile, path, box, reading);
    // A file without points has a header all the same.
    if (!near) near = open_point_source(path, reading);
    const bool all = job.ground_from == TileGroundFrom::kAll;
    const double metres = plan.metres;
    source = select_rows(std::move(near), [this, all, metres](const PointStreamHeader& header,
                                                              const PointBatch& batch,
                                                              std::vector<unsigned char>* keep) {
      throw_if_interrupted();
      const SiteColumns columns(header);
      SitePoint point;
      for (std::size_t i = 0; i < batch.count; ++i) {
        (*keep)[i] = columns.take(header, batch, i, &point) &&
                     (all ? point.kind != 9 : is_ground_class(point.kind)) &&
                     corridor_->contains(metres * point.place);
      }
      read_points += batch.count;
    });
  }

  TileGround ground_;
  TileInliers inliers_;
  std::unique_ptr<ProfileCorridor> corridor_;
  std::unique_ptr<TileVoxels> voxels_;
  TileNormals normals_;
  std::vector<int> labels_;
  std::vector<float> distances_;
  std::size_t place_ = 0;
};

/// But for what a killed run had staged.
bool holds_files(const fs::path& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().filename().string()[0] != '.') return true;
  }
  return false;
}

}  // namespace

std::optional<CoordinateSystem> system_of_tiles(const TilePlan& plan,
                                                const std::optional<CoordinateSystem>& given,
                                                const FindSystem& find) {
  ReadOptions reading;
  reading.crs = given;
  std::optional<CoordinateSystem> out = open_point_source(plan.path_of(0), reading)->header().crs;
  if (out) complete_system(&*out, find);
  return out;
}

void set_raster_system(const TilePlan& plan, const CoordinateSystem& system, TileJob* job) {
  if (system.horizontal.angle) {
    throw NoAnswerError(plan.path_of(0).string() +
                        ": the coordinates are longitude and latitude (" + describe(system) +
                        "); rasters of tiles need coordinates on a map");
  }
  job->crs = definition_for_raster(system);
  job->height_unit = height_unit_of(system);
}

const char* to_string(TileJob::Kind kind) {
  switch (kind) {
    case TileJob::Kind::kFilter:
      return "filter";
    case TileJob::Kind::kVoxels:
      return "voxels";
    case TileJob::Kind::kNormals:
      return "normals";
    case TileJob::Kind::kPatches:
      return "patches";
    case TileJob::Kind::kCompare:
      return "compare";
    case TileJob::Kind::kLabels:
      return "labels";
    case TileJob::Kind::kExport:
      return "export";
    case TileJob::Kind::kProfile:
      return "profile";
    case TileJob::Kind::kGround:
      break;
  }
  return "ground";
}

void TileJob::validate() const {
  if (kind == Kind::kPatches) surface.validate();
  if (kind == Kind::kGround || kind == Kind::kPatches || kind == Kind::kLabels) return;
  if (kind == Kind::kExport) {
    for (const auto& [name, length] :
         {std::pair("step", step), std::pair("fill_holes", fill_holes)}) {
      if (std::isfinite(length) && length >= 0.0 && length <= 1e4) continue;
      throw std::invalid_argument(
          fmt::format("{} = {}, expected at least 0 and at most 10000 m", name, length));
    }
    return;
  }
  if (kind == Kind::kProfile) {
    CloudProfileOptions options;
    options.half_width = half_width;
    return options.validate();
  }
  const bool cubes = kind == Kind::kVoxels;
  const double length = cubes ? voxel : radius;
  if (!(std::isfinite(length) && length > 0.0 && length <= 1e4)) {
    throw std::invalid_argument(fmt::format("{} = {}, expected more than 0 and at most 10000 m",
                                            cubes ? "voxel" : "radius", length));
  }
  for (const double t : thresholds) {
    if (!(t > 0.0 && t <= radius) && kind == Kind::kCompare) {
      throw std::invalid_argument(fmt::format(
          "thresholds: found {}, expected more than 0 and at most the radius, {}", t, radius));
    }
  }
  if (cubes || kind == Kind::kCompare) return;
  const int least = kind == Kind::kFilter ? 1 : 3;
  if (neighbors < least) {
    throw std::invalid_argument(
        fmt::format("neighbors = {}, expected at least {}", neighbors, least));
  }
}

fs::path job_folder(const TilePlan& plan, const TileJob& job) {
  return job.folder.empty() ? plan.folder / to_string(job.kind) : job.folder;
}

void begin_tile_job(const TilePlan& plan, const TileJob& job) {
  job.validate();
  const fs::path folder = job_folder(plan, job), path = folder / "job.json";
  const json options = options_json(plan, job);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  if (!fs::exists(path, error) && holds_files(folder)) {
    throw OutputError(folder.string(), "the folder is not empty and holds no results of tiles");
  }
  if (!fs::exists(path, error)) {
    json all = options;
    if (job.kind == TileJob::Kind::kExport) {
      const RasterPlan raster = decide_raster(plan, ground_files(plan, job), job.ground_from,
                                              job.step, job.fill_holes, job.num_threads);
      all["raster"] = {{"cell", raster.cell}, {"reach", raster.reach}};
    }
    return write_file_atomically(path, format_json(all));
  }
  const json there = parse_json(read_whole_file(path), path.string());
  for (const auto& [key, value] : options.items()) {
    if (there.is_object() && there.value(key, json()) == value) continue;
    throw UsageError(fmt::format(
        "{}: found results of a job with another value of '{}' ({}), "
        "expected the same job, or another --out",
        folder.string(), key, there.is_object() ? there.value(key, json()).dump() : "none"));
  }
}

namespace {

std::map<std::string, std::string> raster_metadata(TileGroundFrom from) {
  return {{"TIFFTAG_SOFTWARE", std::string("Camber ") + kVersion},
          {"TIFFTAG_IMAGEDESCRIPTION", "ground and surface of a cloud's points"},
          {"CAMBER_GROUND_FROM", to_string(from)}};
}

/// Writes the raster of a tile, and says in `done` what it has.
void write_tile_raster(const TilePlan& plan, const TileJob& job, std::size_t tile,
                       const fs::path& out, TileDone* done) {
  if (!job.write_raster) throw std::invalid_argument("write_raster: found none, expected one");
  const RasterPlan raster = read_raster_plan(job_folder(plan, job) / "job.json");
  TileRaster found = make_tile_raster(plan, tile, ground_files(plan, job), job.ground_from, raster,
                                      job.num_threads);
  done->window = found.window;
  done->points = plan.tiles[tile].points;
  done->read_points = found.read_points;
  done->counts = {{"cells", found.cells}, {"known", found.known}};
  AtomicFiles numbers, files;  // the numbers are removed again
  RawRaster raw;
  raw.file = numbers.stage(out.string() + ".raw").string();
  raw.name = out.string();
  raw.grid.cell = raster.cell;
  raw.grid.west = static_cast<double>(found.window.column) * raster.cell;
  raw.grid.north = -static_cast<double>(found.window.row) * raster.cell;
  raw.grid.columns = found.rows.window.columns;
  raw.grid.rows = found.rows.window.rows;
  raw.bands = site_bands(job.height_unit);
  write_file_atomically(raw.file, [&](std::ostream& to) {
    for (const std::vector<float>& band : site_band_values(std::move(found.rows))) {
      to.write(reinterpret_cast<const char*>(band.data()),
               static_cast<std::streamsize>(band.size() * sizeof(float)));
    }
  });
  job.write_raster(raw, job.crs, raster_metadata(job.ground_from), files.stage(out).string());
  files.commit();
}

}  // namespace

namespace {

TileDone run_tile(const TilePlan& plan, const TileJob& job, std::size_t tile,
                  detail::KeptParts* kept) {
  TileDone done;
  if (find_done(plan, job, tile, &done)) {
    done.was_there = true;
    return done;
  }
  const fs::path folder = job_folder(plan, job);
  done = {};
  done.name = plan.tiles[tile].name;
  const bool pieces = job.kind == TileJob::Kind::kPatches;
  const bool cells = job.kind == TileJob::Kind::kExport;
  done.file = done.name + (pieces ? kPiecesSuffix : cells ? ".tif" : ".laz");
  const fs::path out = folder / done.file;
  if (pieces) {
    RoadSurfaceOptions options = job.surface;
    options.num_threads = job.num_threads;
    const TilePieces found = find_tile_pieces(plan, tile, options, kept);
    write_file_atomically(out, found.bytes);
    done.points = plan.tiles[tile].points;
    done.read_points = found.read_points;
    done.counts = {{"pieces", found.pieces}, {"on_pieces", found.on_pieces}};
  } else if (cells) {
    write_tile_raster(plan, job, tile, out, &done);
  } else {
    const Found found(plan, job, tile, kept);
    done.points = write_points(*found.source, out);
    done.read_points = found.read_points;
    done.counts = found.counts;
  }
  std::error_code error;
  done.bytes = fs::file_size(out, error);
  if (error) throw OutputError(out.string(), error.message());
  done.hash = hash_file(out);
  json document = done_json(done);
  document["plan"] = plan.hash;
  write_file_atomically(done_path(plan, job, tile), format_json(document));
  return done;
}

}  // namespace

TileDone run_tile_job(const TilePlan& plan, const TileJob& job, std::size_t tile) {
  return run_tile(plan, job, tile, nullptr);
}

TilesRun run_tile_job(const TilePlan& plan, const TileJob& job,
                      const std::vector<std::size_t>& tiles, const Progress& progress) {
  begin_tile_job(plan, job);
  TilesRun out;
  detail::KeptParts kept;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    if (progress) {
      progress(to_string(job.kind), static_cast<double>(i) / static_cast<double>(tiles.size()));
    }
    throw_if_interrupted();
    kept.set_next(i + 1 < tiles.size() ? tiles[i + 1] : plan.tiles.size());
    const TileDone done = run_tile(plan, job, tiles[i], &kept);
    out.points += done.points;
    if (done.was_there) {
      ++out.done_before;
    } else {
      out.points_read += done.read_points;
      out.points_answered += plan.tiles[tiles[i]].points;
    }
    for (const auto& [name, count] : done.counts) out.counts[name] += count;
  }
  if (progress) progress(to_string(job.kind), 1.0);
  return out;
}

TileJob::Kind tile_job_from_string(const std::string& name) {
  std::string names;
  for (const TileJob::Kind kind :
       {TileJob::Kind::kGround, TileJob::Kind::kFilter, TileJob::Kind::kVoxels,
        TileJob::Kind::kNormals, TileJob::Kind::kPatches, TileJob::Kind::kCompare,
        TileJob::Kind::kLabels, TileJob::Kind::kExport, TileJob::Kind::kProfile}) {
    if (name == to_string(kind)) return kind;
    names += (names.empty() ? "" : ", ") + std::string(to_string(kind));
  }
  throw std::invalid_argument("job: found '" + name + "', expected one of " + names);
}

int default_neighbors(TileJob::Kind kind) { return kind == TileJob::Kind::kFilter ? 1 : 30; }

std::vector<std::size_t> tiles_of_shard(const TilePlan& plan, std::size_t shard,
                                        std::size_t shards) {
  if (shard < 1 || shard > shards) {
    throw std::invalid_argument(fmt::format("shard = {}, expected 1 to {}", shard, shards));
  }
  // In runs: tiles side by side, whose halos the system has still in memory.
  double all = 0.0, before = 0.0;
  for (const Tile& tile : plan.tiles) all += static_cast<double>(tile.points);
  std::vector<std::size_t> out;
  for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
    const auto points = static_cast<double>(plan.tiles[k].points);
    const double middle = (before + 0.5 * points) / std::max(all, 1.0);
    before += points;
    const auto part = static_cast<std::size_t>(middle * static_cast<double>(shards));
    if (std::min(part, shards - 1) == shard - 1) out.push_back(k);
  }
  return out;
}

bool is_joined(const fs::path& folder) {
  std::error_code error;
  const fs::path path = folder / "index.json";
  // No other folder that is read has a job.json.
  return fs::is_regular_file(path, error) && fs::is_regular_file(folder / "job.json", error);
}

std::vector<JoinedFile> joined_files(const fs::path& folder) {
  const fs::path path = folder / "index.json";
  const json document = parse_json(read_whole_file(path, std::size_t{4} << 30), path.string());
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "joined tiles");
  const JsonCursor format = object.require("format", "\"camber-tile-job\"");
  if (format.text() != "camber-tile-job") format.fail("\"camber-tile-job\"");
  const JsonCursor kind = object.require("job", "the name of a job");
  if (kind.text() == "export") kind.fail("the job of tiles that are points");
  std::vector<JoinedFile> out;
  for (const JsonCursor& cursor : object.require("tiles", "tiles").items("tiles")) {
    JsonObject tile(cursor, "a tile");
    JsonObject bounds(tile.require("bounds", "bounds"), "bounds");
    out.push_back({folder / tile.require("file", "the name of its file").file_path(),
                   {bounds.require("min", "3 numbers").vector3(),
                    bounds.require("max", "3 numbers").vector3()}});
  }
  if (out.empty()) object.cursor().fail_because("found no tiles, expected at least one");
  return out;
}

namespace {

/// All tiles of a job, each as it was left.
std::vector<TileDone> all_done(const TilePlan& plan, const TileJob& job) {
  const fs::path folder = job_folder(plan, job);
  std::vector<TileDone> out;
  std::vector<std::string> missing;
  for (std::size_t k = 0; k < plan.tiles.size(); ++k) {
    TileDone done;
    if (!find_done(plan, job, k, &done)) {
      missing.push_back(plan.tiles[k].name);
      continue;
    }
    if (hash_file(folder / done.file) != done.hash) {
      throw InputError((folder / done.file).string(),
                       "found other content than was written; remove it and repeat tiles run");
    }
    out.push_back(std::move(done));
  }
  if (!missing.empty()) {
    throw NoAnswerError(
        fmt::format("{}: {} of {} tiles are not done, the first is {}; repeat "
                    "camber tiles run",
                    folder.string(), missing.size(), plan.tiles.size(), missing.front()));
  }
  return out;
}

}  // namespace

JoinedTiles join_tiles(const TilePlan& plan, const TileJob& job) {
  const fs::path folder = job_folder(plan, job);
  JoinedTiles out;
  out.tiles = all_done(plan, job);
  for (const TileDone& done : out.tiles) {
    out.points += done.points;
    for (const auto& [name, count] : done.counts) out.counts[name] += count;
  }
  json tiles = json::array();
  for (std::size_t k = 0; k < out.tiles.size(); ++k) {
    json tile = done_json(out.tiles[k]);
    tile.erase("points_read");
    tile["bounds"] = {{"min", vector_json(plan.tiles[k].bounds.min())},
                      {"max", vector_json(plan.tiles[k].bounds.max())}};
    tiles.push_back(std::move(tile));
  }
  if (job.kind == TileJob::Kind::kExport) {
    std::vector<std::string> files;
    std::vector<CellWindow> windows;
    for (const TileDone& done : out.tiles) {
      if (!done.window) {
        throw InputError((folder / (done.name + ".json")).string(),
                         "window: missing, expected [column, row, columns, rows]");
      }
      files.push_back(done.file.generic_string());
      windows.push_back(*done.window);
    }
    const fs::path options = folder / "job.json";
    const json there = parse_json(read_whole_file(options), options.string());
    JsonContext context{options.string(), {}};
    JsonObject given(JsonCursor(there, context), "the options of a job");
    write_file_atomically(mosaic_path(plan, job),
                          raster_mosaic(files, windows, read_raster_plan(options),
                                        given.require("crs", "a coordinate system, or \"\"").text(),
                                        given.require("height_unit", "the unit of heights").text(),
                                        raster_metadata(ground_from_string(given.require(
                                            "ground_from", "where the ground is from")))));
  }
  out.index = folder / "index.json";
  write_file_atomically(out.index, format_json({{"format", "camber-tile-job"},
                                                {"version", 1},
                                                {"job", to_string(job.kind)},
                                                {"plan", plan.hash},
                                                {"crs", plan.crs},
                                                {"points", out.points},
                                                {"counts", out.counts},
                                                {"tiles", tiles}}));
  return out;
}

fs::path mosaic_path(const TilePlan& plan, const TileJob& job) {
  return job_folder(plan, job) / "mosaic.vrt";
}

std::vector<fs::path> profile_files(const TilePlan& plan, TileJob* job) {
  const fs::path folder = job_folder(plan, *job), path = folder / "job.json";
  const json document = parse_json(read_whole_file(path), path.string());
  JsonContext context{path.string(), {}};
  JsonObject object(JsonCursor(document, context), "the options of a job");
  if (object.require("line", "the hash of a line").text() != line_hash(job->line)) {
    throw UsageError(path.string() +
                     ": found results of another line, expected that of tiles run (--along)");
  }
  job->half_width = object.require("half_width", "a length").positive();
  job->ground_from = ground_from_string(object.require("ground_from", "where the ground is from"));
  std::vector<fs::path> out;
  for (const TileDone& done : all_done(plan, *job)) {
    if (done.points > 0) out.push_back(folder / done.file);
  }
  return out;
}

namespace {

/// Metres.
std::vector<SurfaceTileSquare> squares_of(const TilePlan& plan) {
  std::vector<SurfaceTileSquare> out;
  for (const Tile& tile : plan.tiles) {
    Eigen::AlignedBox2d square(Eigen::Vector2d(tile.bounds.min().head<2>()),
                               Eigen::Vector2d(tile.bounds.max().head<2>()));
    if (tile.square) {
      square = {Eigen::Vector2d(tile.square->x0, tile.square->y0),
                Eigen::Vector2d(tile.square->x1, tile.square->y1)};
    }
    out.push_back({tile.name, {square.min() * plan.metres, square.max() * plan.metres}});
  }
  return out;
}

}  // namespace

JoinedSurface join_patches(const TilePlan& plan, const TileJob& job) {
  const fs::path folder = job_folder(plan, job);
  JoinedSurface out;
  out.options = job.surface;
  read_surface_options(folder / "job.json", &out.options);
  std::vector<fs::path> files;
  for (const TileDone& done : all_done(plan, job)) {
    files.push_back(folder / done.file);
    out.points += done.points;
    const auto on_pieces = done.counts.find("on_pieces");
    if (on_pieces != done.counts.end()) out.on_pieces += on_pieces->second;
  }
  out.patches = join_tile_patches(files, out.options);
  if (out.patches.fit.status == Status::kFailed) {
    throw NoAnswerError(folder.string() + ": " + out.patches.fit.reason);
  }
  write_surface(out.patches.fit.surface, folder / "surface.json");
  write_surface_tiles(out.patches.fit.surface, squares_of(plan), folder);
  write_file_atomically(folder / "patches.ids", out.patches.ids);
  return out;
}

RunDocument run_document(const TilePlan& plan, const JoinedSurface& joined) {
  RunDocument out;
  out.seed = joined.options.seed;
  out.points_kept = {{"on_pieces", static_cast<long>(joined.on_pieces)}};
  out.points_dropped = {{"on_no_piece", static_cast<long>(joined.points - joined.on_pieces)}};
  out.input_hashes = {{(plan.folder / "index.json").string(), plan.hash}};
  return out;
}

}  // namespace camber
