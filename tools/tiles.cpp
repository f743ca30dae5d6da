// camber tiles: clouds larger than memory, by tiles with exact borders.

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/scene/results.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crs.h"
#include "road_arguments.h"
#include "tile_products.h"

using nlohmann::json;

namespace camber::tools {
namespace {

/// What all three print as JSON.
/// @param found  keys of the command
void print(const Command& command, const std::string& out, const Timings& timings, json found) {
  json used;
  add_other_options(command, &used);
  found["version"] = kVersion;
  found["seed"] = command.common.seed;
  found["options"] = used;
  found["out"] = out;
  found["timings_ms"] = cloud_timings(timings);
  fmt::print("{}\n", found.dump(2, ' ', false, json::error_handler_t::replace));
}

// --- plan --------------------------------------------------------------------------------------

struct PlanArguments {
  std::vector<std::string> clouds;
  std::string out, crs;
  TilePlanOptions options;
  std::vector<double> origin;
  bool as_json = false;
};

json ground_json(const TilePlan& plan) {
  if (!plan.ground) return nullptr;
  const GroundPlan& g = *plan.ground;
  return {{"from_air", g.from_air},   {"cell", g.cell},
          {"slope", g.slope},         {"largest_object", g.largest_object},
          {"tolerance", g.tolerance}, {"foot_tolerance", g.foot_tolerance},
          {"reach", g.reach()}};
}

int run_plan(const Command& command, const PlanArguments& arguments) {
  TilePlanOptions options = arguments.options;
  if (!arguments.crs.empty()) options.crs = crs_from_option(arguments.crs);
  if (!arguments.origin.empty()) options.origin = {arguments.origin[0], arguments.origin[1]};
  if (options.in_place && (options.side > 0.0 || !arguments.origin.empty())) {
    throw UsageError(
        "--in-place: found --tile or --tile-origin beside it, expected neither: the "
        "survey's files are the tiles");
  }
  options.num_threads = command.common.threads;
  const LogSink warn = make_warning_sink(command.common);
  take_units_of(arguments.clouds.front(), look_up_crs, warn, &options);
  const std::vector<std::filesystem::path> clouds(arguments.clouds.begin(), arguments.clouds.end());
  Timings timings;
  StageTimer compute(timings, "compute");
  const TilePlan plan =
      plan_tiles(clouds, arguments.out, options, make_progress(command.common), warn);
  compute.stop();
  std::uint64_t largest = 0;
  for (const Tile& tile : plan.tiles) largest = std::max(largest, tile.points);
  if (!plan.ground && warn) warn(arguments.out + ": no ground: " + plan.ground_reason);
  if (!arguments.as_json) {
    fmt::print("{}: {} points in {} tiles, at most {} in one", arguments.out, plan.points,
               plan.tiles.size(), largest);
    if (plan.ground) {
      fmt::print("; ground {}, cells of {:g} m, {:.0f} m around a tile",
                 plan.ground->from_air ? "seen from the air" : "seen from the street",
                 plan.ground->cell, plan.ground->reach());
    }
    fmt::print("\n");
    return 0;
  }
  print(command, arguments.out, timings,
        {{"crs", plan.crs.empty() ? json(nullptr) : json(plan.crs)},
         {"points", plan.points},
         {"tiles", plan.tiles.size()},
         {"largest_tile", largest},
         {"ground", ground_json(plan)}});
  return 0;
}

void register_plan(App& tiles) {
  Command* command = add_command(
      tiles, "plan",
      "Sorts the points of LAS, LAZ and COPC files of any size into square tiles (LAZ) and decides "
      "what all tiles must have in common. An interrupted plan goes on where it was; a plan that "
      "is "
      "complete stays as it is.",
      "  camber tiles plan survey/*.laz --out plan\n"
      "  camber tiles plan city.copc.laz --tile 500 --out plan --json\n"
      "  camber tiles plan survey/*.laz --in-place --out plan");
  const auto arguments = std::make_shared<PlanArguments>();
  App& app = *command->app;
  TilePlanOptions& options = arguments->options;
  app.add_option("clouds", arguments->clouds, "LAS, LAZ or COPC files")->required();
  app.add_option("--out", arguments->out, "folder of the plan and its tiles")
      ->output_folder()
      ->required();
  app.add_option("--tile", options.side, "metres, side of a tile; 0: for about 1e7 points a tile")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--tile-origin", arguments->origin,
                 "x,y of a corner of tiles, in the files' units; default: 0,0")
      ->check(finite_number())
      ->delimiter(',')
      ->expected(2);
  app.add_flag("--in-place", options.in_place,
               "the files are the tiles and stay where they are; points that stand in two files "
               "are answered in each");
  app.add_option("--crs", arguments->crs,
                 "coordinate system of the files, in place of the one that they state: EPSG:n, "
                 "well-known text, a PROJ string, or a file with one of them");
  app.add_option("--cell", options.ground.cell,
                 "metres, of the ground's grid; 0: 1, or by the points' spacing from the air")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--largest-object", options.ground.largest_object,
                 "metres, shorter side of what may stand on the ground; 0: 12, from the air 30")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--slope", options.ground.slope,
                 "rise over run within which the ground bends; 0: 0.2, from the air 0.35")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--tolerance", options.ground.tolerance,
                 "metres of ground points from the surface; 0: by their scatter in sample tiles")
      ->check(non_negative_number())
      ->capture_default_str();
  app.add_option("--keep-classes", options.keep_classes,
                 "ASPRS classes whose points take no part in the search for ground and keep them: "
                 "7 and 18 noise, 9 water, 17 bridges; so do withheld points")
      ->check(in_range(0, 255))
      ->delimiter(',')
      ->capture_default_str();
  app.add_flag("--overwrite", options.overwrite,
               "replace a plan with other inputs or options, and all its results");
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");
  command->run = [command, arguments] { return run_plan(*command, *arguments); };
}

// --- run, join ---------------------------------------------------------------------------------

struct JobArguments {
  std::string plan, job, shard, out, patches, truth, ground, ground_from = "job", crs, cog;
  std::optional<int> tile;
  TileJob options;
  TileLine line;
  CloudProfileOptions profile;
  SurfaceArguments surface;
  bool as_json = false;
};

TileJob job_of(const Command& command, const JobArguments& arguments) {
  TileJob job = arguments.options;
  job.folder = arguments.out;
  job.num_threads = command.common.threads;
  job.kind = tile_job_from_string(arguments.job);
  job.patches = arguments.patches;
  job.truth = arguments.truth;
  job.ground = arguments.ground;
  job.ground_from = arguments.ground_from == "class" ? TileGroundFrom::kClass
                    : arguments.ground_from == "all" ? TileGroundFrom::kAll
                                                     : TileGroundFrom::kJob;
  job.surface = arguments.surface.in_force(command.common);
  return job;
}

void add_job_arguments(App& app, JobArguments& arguments) {
  app.add_option("plan", arguments.plan, "folder that camber tiles plan wrote")->required();
  app.add_option(
         "--job", arguments.job,
         "what is done with the tiles: ground (classes 2 and 1), filter (leaves out points "
         "with few others near by), voxels (one point for each cube), normals (up in z), "
         "patches (pieces of planar patches, which join makes one surface of), labels (adds "
         "each point's patch, after the join of patches), compare (adds the distance to "
         "the nearest point of another plan), export (rasters of ground and surface, after the "
         "join of ground) or profile (points of the ground near a line, which join measures along "
         "it)")
      ->check(is_member({"ground", "filter", "voxels", "normals", "patches", "labels", "compare",
                         "export", "profile"}))
      ->required();
  app.add_option("--out", arguments.out, "folder of the results; default: PLAN/JOB")
      ->output_folder();
}

/// What both need of a line.
void add_tile_line(App& app, JobArguments& arguments) {
  app.add_option("--along", arguments.line.file,
                 "of profile: points of a line in order, in the tiles' coordinates and units, or "
                 "GeoJSON, GeoPackage, Shapefile, DXF or LandXML (.xml), transformed where it "
                 "states another coordinate system");
  add_line_arguments(app, arguments.line.reading);
}

/// The tiles that are asked for.
std::vector<std::size_t> tiles_of(const TilePlan& plan, const JobArguments& arguments) {
  if (arguments.tile) {
    const auto tile = static_cast<std::size_t>(*arguments.tile);
    if (*arguments.tile < 0 || tile >= plan.tiles.size()) {
      throw UsageError(fmt::format("--tile: found {}, expected 0 to {}, the number of a tile of {}",
                                   *arguments.tile, plan.tiles.size() - 1, arguments.plan));
    }
    return {tile};
  }
  unsigned long long shard = 1, shards = 1;
  if (!arguments.shard.empty()) {
    char rest = 0;
    const bool digits =
        arguments.shard.find_first_not_of("0123456789/") == std::string::npos &&
        std::sscanf(arguments.shard.c_str(), "%llu/%llu%c", &shard, &shards, &rest) == 2;
    if (!digits || shard < 1 || shard > shards || shards > 1000000000) {
      throw UsageError("--shard: found '" + arguments.shard +
                       "', expected i/n: part i, from 1, of n");
    }
  }
  return tiles_of_shard(plan, static_cast<std::size_t>(shard), static_cast<std::size_t>(shards));
}

int run_job(const Command& command, const JobArguments& arguments) {
  Timings timings;
  StageTimer load(timings, "load");
  const TilePlan plan = read_tile_plan(arguments.plan);
  const std::vector<std::size_t> tiles = tiles_of(plan, arguments);
  load.stop();
  TileJob job = job_of(command, arguments);
  const bool compare = job.kind == TileJob::Kind::kCompare;
  const bool near =
      compare || job.kind == TileJob::Kind::kFilter || job.kind == TileJob::Kind::kNormals;
  if (near && !(job.radius > 0.0)) {
    throw UsageError(std::string("--job ") + to_string(job.kind) +
                     ": expected --radius beside it: nearest points of any distance have no tile");
  }
  if (compare && job.truth.empty()) {
    throw UsageError("--job compare: expected --truth beside it: the plan of another survey");
  }
  if (job.kind == TileJob::Kind::kVoxels && !(job.voxel > 0.0)) {
    throw UsageError("--job voxels: expected --voxel beside it");
  }
  if (job.kind == TileJob::Kind::kExport) prepare_rasters(plan, arguments.crs, &job);
  if (job.kind == TileJob::Kind::kProfile) {
    TileLine line = arguments.line;
    line.crs = arguments.crs;
    job.line = read_tile_line(plan, line, make_warning_sink(command.common));
  }
  if (job.neighbors == 0) job.neighbors = default_neighbors(job.kind);
  if (job.kind == TileJob::Kind::kNormals && job.neighbors < 3) {
    throw UsageError("--neighbors: found less than 3, expected at least 3 for a plane");
  }
  StageTimer compute(timings, "compute");
  const TilesRun done = run_tile_job(plan, job, tiles, make_progress(command.common));
  compute.stop();
  if (!arguments.as_json) {
    fmt::print("{}: {} of {} tiles, {} points", job_folder(plan, job).string(), tiles.size(),
               plan.tiles.size(), done.points);
    const auto count = [&](const std::string& name) {
      const auto found = done.counts.find(name);
      return found == done.counts.end() ? std::uint64_t{0} : found->second;
    };
    for (const auto& [name, words] :
         {std::pair("ground", "ground"), std::pair("normals", "with a normal"),
          std::pair("on_patches", "on patches")}) {
      if (done.counts.count(name) > 0) fmt::print(", {} of them {}", count(name), words);
    }
    if (done.counts.count("pieces") > 0) {
      fmt::print(", {} of them on {} pieces of patches", count("on_pieces"), count("pieces"));
    }
    if (done.counts.count("cells") > 0) {
      fmt::print(", {} cells, the ground of {} of them known", count("cells"), count("known"));
    }
    if (compare) {
      fmt::print(", {} of them within {:g} m of the truth", count("compared"), job.radius);
      for (const double t : job.thresholds) {
        fmt::print(", {} within {:g}", count(fmt::format("within_{:g}", t)), t);
      }
    }
    if (done.done_before > 0) fmt::print("; {} tiles were done before", done.done_before);
    fmt::print("\n");
    return 0;
  }
  print(command, job_folder(plan, job).string(), timings,
        {{"tiles", tiles.size()},
         {"done_before", done.done_before},
         {"points", done.points},
         {"counts", done.counts},
         {"points_read", done.points_read},
         {"points_answered", done.points_answered}});
  return 0;
}

void register_run(App& tiles) {
  Command* command = add_command(
      tiles, "run",
      "Works on the tiles of a plan, each with as many points around it as its answers hang on: "
      "the result is that of the whole cloud. Tiles that are done are passed over, so that a run "
      "that was stopped is repeated; several runs may share the tiles.",
      "  camber tiles run plan --job ground\n"
      "  camber tiles run plan --job ground --tile 7\n"
      "  camber tiles run plan --job ground --shard 2/8 --json\n"
      "  camber tiles run plan --job normals --radius 1.5\n"
      "  camber tiles run plan --job voxels --voxel 0.5\n"
      "  camber tiles run plan --job patches\n"
      "  camber tiles run plan --job compare --truth plan_of_2024 --radius 1\n"
      "  camber tiles run plan --job export --step 0.5\n"
      "  camber tiles run plan --job profile --along centreline.csv");
  const auto arguments = std::make_shared<JobArguments>();
  App& app = *command->app;
  add_job_arguments(app, *arguments);
  app.add_option("--radius", arguments->options.radius,
                 "metres, of filter, normals and compare: what counts as near")
      ->check(positive_number());
  app.add_option("--voxel", arguments->options.voxel, "metres, of voxels: edge of a cube")
      ->check(positive_number());
  app.add_option("--neighbors", arguments->options.neighbors,
                 "filter: others that a point needs within the radius (1); normals: points of a "
                 "plane, the nearest within the radius (30)")
      ->check(positive_number())
      ->default_varies();
  app.add_option("--threshold", arguments->surface.options.inlier_threshold,
                 "metres, of patches: from a plane that make an inlier; 0: from the noise")
      ->check(non_negative_number())
      ->capture_default_str();
  add_segment_arguments(app, arguments->surface);
  app.add_option("--truth", arguments->truth, "folder of the plan that compare measures against");
  app.add_option("--thresholds", arguments->options.thresholds,
                 "metres, of compare: points within each are counted")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--patches", arguments->patches,
                 "folder of the joined patches, of labels; default: PLAN/patches");
  app.add_option("--ground", arguments->ground,
                 "folder of the joined ground, of export and profile; default: PLAN/ground");
  app.add_option("--ground-from", arguments->ground_from,
                 "where the ground of export and profile is from: job (the joined ground), class "
                 "(ASPRS classes 2 and 11 of the plan's own tiles) or all (every point of them but "
                 "water)")
      ->check(is_member({"job", "class", "all"}))
      ->capture_default_str();
  app.add_option("--step", arguments->options.step,
                 "metres, of export: side of a cell; 0: by how far apart the ground's points of "
                 "sample tiles lie")
      ->check(in_range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--fill-holes", arguments->options.fill_holes,
                 "metres, of export: width of the holes of the ground that are filled from the "
                 "ground around")
      ->check(in_range(0.0, 1000.0))
      ->capture_default_str();
  add_tile_line(app, *arguments);
  app.add_option("--half-width", arguments->options.half_width,
                 "metres to either side of the line over which profile measures the cross slope")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option("--crs", arguments->crs,
                 "of export and profile: coordinate system of the tiles, in place of the one that "
                 "they state: EPSG:n, well-known text, a PROJ string, or a file with one of them");
  app.add_option("--shard", arguments->shard, "i/n: part i, from 1, of n parts of the tiles")
      ->no_name();
  app.add_option("--tile", arguments->tile, "one tile, by its number in index.json, from 0")
      ->excludes("--shard");
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");
  command->run = [command, arguments] { return run_job(*command, *arguments); };
}

/// The surface of a plan: surface.json and run.json, as `camber patches` writes them.
int join_surface(const Command& command, const JobArguments& arguments, const TilePlan& plan,
                 const TileJob& job) {
  Timings timings;
  StageTimer compute(timings, "compute");
  const JoinedSurface joined = join_patches(plan, job);
  compute.stop();
  const std::filesystem::path folder = job_folder(plan, job);
  const RoadSurfaceFit& fit = joined.patches.fit;
  const LogSink warn = make_warning_sink(command.common);
  if (warn && fit.status == Status::kWeak) warn(folder.string() + ": " + fit.reason);
  RunDocument document = run_document(plan, joined);
  add_other_options(command, &*document.options);
  document.timings = timings;
  write_json(to_json(document), folder / "run.json");
  const std::size_t patches = fit.surface.patches.size();
  if (!arguments.as_json) {
    fmt::print("{}: {} patches of {} pieces in {} squares, {} of {} points\n", folder.string(),
               patches, joined.patches.pieces, joined.patches.blocks, joined.on_pieces,
               joined.points);
    return 0;
  }
  print(command, folder.string(), timings,
        {{"tiles", plan.tiles.size()},
         {"points", joined.points},
         {"on_pieces", joined.on_pieces},
         {"pieces", joined.patches.pieces},
         {"patches", patches},
         {"links", fit.surface.links.size()},
         {"noise", fit.noise}});
  return 0;
}

int run_join(const Command& command, const JobArguments& arguments) {
  Timings timings;
  StageTimer compute(timings, "compute");
  const TilePlan plan = read_tile_plan(arguments.plan);
  const TileJob job = job_of(command, arguments);
  if (job.kind == TileJob::Kind::kPatches) return join_surface(command, arguments, plan, job);
  if (!arguments.cog.empty()) {
    if (job.kind != TileJob::Kind::kExport) {
      throw UsageError(std::string("--cog: found --job ") + to_string(job.kind) +
                       ", expected --job export");
    }
    check_output_file(arguments.cog);
  }
  json found = json::object();
  if (job.kind == TileJob::Kind::kProfile) {
    compute.stop();
    TileLine line = arguments.line;
    line.crs = arguments.crs;
    found = join_profile(command, plan, job, line, arguments.profile, &timings);
  }
  const JoinedTiles joined = join_tiles(plan, job);
  if (!arguments.cog.empty()) write_mosaic(plan, job, arguments.cog);
  compute.stop();
  if (!arguments.as_json) {
    fmt::print("{}: {} points in {} tiles", joined.index.string(), joined.points,
               joined.tiles.size());
    if (job.kind == TileJob::Kind::kProfile) {
      fmt::print(", {} of {} stations", found["covered_stations"].get<std::size_t>(),
                 found["station_count"].get<std::size_t>());
    }
    fmt::print("\n");
    return 0;
  }
  found["tiles"] = joined.tiles.size();
  found["points"] = joined.points;
  found["counts"] = joined.counts;
  if (job.kind == TileJob::Kind::kExport) found["mosaic"] = mosaic_path(plan, job).string();
  print(command, joined.index.string(), timings, std::move(found));
  return 0;
}

void register_join(App& tiles) {
  Command* command = add_command(
      tiles, "join",
      "Joins the results of all tiles of a plan: checks that each is there and writes one index. "
      "Of patches: pieces of one plane become one patch, with one consistency graph, as "
      "surface.json "
      "and run.json. Of export: mosaic.vrt, one raster of all. Of profile: profile.csv and "
      "profile.json.",
      "  camber tiles join plan --job ground\n"
      "  camber tiles join plan --job patches --consistency continuity\n"
      "  camber tiles join plan --job export --cog terrain.tif\n"
      "  camber tiles join plan --job profile --along centreline.csv --crown");
  const auto arguments = std::make_shared<JobArguments>();
  App& app = *command->app;
  add_job_arguments(app, *arguments);
  add_graph_arguments(app, arguments->surface);
  app.add_option("--cog", arguments->cog,
                 "of export: also one Cloud Optimized GeoTIFF of all, under this name")
      ->output_file();
  add_tile_line(app, *arguments);
  app.add_option("--step", arguments->profile.profile.step, "metres, of profile: between stations")
      ->check(positive_number())
      ->capture_default_str();
  app.add_option("--length", arguments->profile.profile.length,
                 "metres, of profile: of road over which grade and vertical radius are measured")
      ->check(positive_number())
      ->capture_default_str();
  app.add_flag("--crown", arguments->profile.crown,
               "of profile: also the cross slopes left and right of the crest");
  app.add_option("--crs", arguments->crs, "of profile: coordinate system of the tiles, as of run");
  app.add_flag("--json", arguments->as_json, "one JSON object on stdout");
  command->run = [command, arguments] { return run_join(*command, *arguments); };
}

}  // namespace

void register_tiles(App& root) {
  App* tiles = root.add_subcommand(
      "tiles", "Clouds larger than memory: sorted into tiles, worked on one by one, joined");
  tiles->require_subcommand();
  register_plan(*tiles);
  register_run(*tiles);
  register_join(*tiles);
}

}  // namespace camber::tools
