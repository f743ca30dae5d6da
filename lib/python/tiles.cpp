// plan_tiles, run_tiles and join_tiles: clouds larger than memory.

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/import/maps/proj_systems.h"
#include "camber/scene/results.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "convert.h"
#include "running.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

py::dict planned(const std::vector<fs::path>& clouds, const fs::path& out, TilePlanOptions options,
                 const std::string& crs, const py::object& progress) {
  if (clouds.empty()) throw std::invalid_argument("clouds: found none, expected files");
  if (!crs.empty()) {
    CoordinateSystem system;
    std::string reason;
    if (!system_of_definition(crs, find_coordinate_system, &system, &reason)) {
      throw std::invalid_argument("crs: found '" + crs.substr(0, 80) + "': " + reason);
    }
    options.crs = system;
  }
  const LogSink warn = python_warnings();
  take_units_of(clouds.front(), find_coordinate_system, warn, &options);
  options.validate();
  const Progress report = to_progress(progress);
  const TilePlan plan = compute([&] { return plan_tiles(clouds, out, options, report, warn); });
  py::dict done;
  done["points"] = plan.points;
  done["tiles"] = plan.tiles.size();
  done["crs"] = plan.crs.empty() ? py::object(py::none()) : py::str(plan.crs);
  done["ground"] = plan.ground.has_value();
  if (!plan.ground) done["ground_reason"] = plan.ground_reason;
  return done;
}

/// The tiles that are asked for: one, a shard, or all.
std::vector<std::size_t> chosen(const TilePlan& plan, const std::optional<std::size_t>& tile,
                                const std::optional<std::pair<std::size_t, std::size_t>>& shard) {
  if (tile && shard) throw std::invalid_argument("tile: found shard beside it, expected one");
  if (tile && *tile >= plan.tiles.size()) {
    throw std::invalid_argument("tile: found " + std::to_string(*tile) + ", expected 0 to " +
                                std::to_string(plan.tiles.size() - 1));
  }
  if (tile) return {*tile};
  const auto [part, parts] = shard.value_or(std::pair<std::size_t, std::size_t>(1, 1));
  if (part < 1 || part > parts) {
    throw std::invalid_argument("shard: found (" + std::to_string(part) + ", " +
                                std::to_string(parts) + "), expected (i, n): part i, from 1, of n");
  }
  return tiles_of_shard(plan, part, parts);
}

TileJob job_of(const std::string& name, const fs::path& out) {
  TileJob job;
  job.kind = tile_job_from_string(name);
  if (job.kind == TileJob::Kind::kExport || job.kind == TileJob::Kind::kProfile) {
    throw std::invalid_argument("job: found '" + name +
                                "', expected 'ground', 'filter', 'voxels', 'normals', 'patches', "
                                "'labels' or 'compare'; camber tiles has the others");
  }
  job.folder = out;
  return job;
}

/// One surface of the pieces of all tiles, with its files.
py::dict joined_patches(const TilePlan& plan, const TileJob& job) {
  const JoinedSurface joined = compute([&] {
    JoinedSurface out = join_patches(plan, job);
    write_json(to_json(run_document(plan, out)), job_folder(plan, job) / "run.json");
    return out;
  });
  py::dict done;
  done["surface"] = job_folder(plan, job) / "surface.json";
  done["tiles"] = plan.tiles.size();
  done["points"] = joined.points;
  done["on_pieces"] = joined.on_pieces;
  done["pieces"] = joined.patches.pieces;
  done["patches"] = joined.patches.fit.surface.patches.size();
  done["links"] = joined.patches.fit.surface.links.size();
  done["noise"] = joined.patches.fit.noise;
  return done;
}

}  // namespace

void bind_tiles(py::module_& module) {
  const TilePlanOptions plan;
  const TileJob defaults;
  module.def(
      "plan_tiles",
      [](const std::vector<fs::path>& clouds, const fs::path& out, double side,
         const std::pair<double, double>& origin, bool in_place, const std::string& crs,
         double cell, double largest_object, double slope, double tolerance,
         const std::vector<int>& keep_classes, bool overwrite, int threads,
         const py::object& progress) {
        TilePlanOptions options;
        options.side = side;
        options.origin = {origin.first, origin.second};
        options.in_place = in_place;
        options.ground.cell = cell;
        options.ground.largest_object = largest_object;
        options.ground.slope = slope;
        options.ground.tolerance = tolerance;
        options.keep_classes = keep_classes;
        options.overwrite = overwrite;
        options.num_threads = threads;
        return planned(clouds, out, options, crs, progress);
      },
      py::arg("clouds"), py::arg("out"), py::kw_only(), py::arg("side") = plan.side,
      py::arg("origin") = std::pair(plan.origin[0], plan.origin[1]), py::arg("in_place") = false,
      py::arg("crs") = "", py::arg("cell") = plan.ground.cell,
      py::arg("largest_object") = plan.ground.largest_object, py::arg("slope") = plan.ground.slope,
      py::arg("tolerance") = plan.ground.tolerance, py::arg("keep_classes") = plan.keep_classes,
      py::arg("overwrite") = false, py::arg("threads") = 0, py::arg("progress") = py::none(),
      with_keywords("Sorts LAS, LAZ and COPC files of any size into tiles, as camber tiles plan.",
                    {{"clouds", "files"},
                     {"out", "folder of the plan and its tiles"},
                     {"side", CAMBER_DOC(TilePlanOptions, side)},
                     {"origin", CAMBER_DOC(TilePlanOptions, origin)},
                     {"in_place", CAMBER_DOC(TilePlanOptions, in_place)},
                     {"crs", "in place of what the files state: EPSG:n or a definition"},
                     {"cell", "m, of the ground's grid; 0: by the points"},
                     {"largest_object",
                      "m, shorter side of what may stand on the ground; 0: 12 or "
                      "30"},
                     {"slope", "rise over run within which the ground bends; 0: 0.2 or 0.35"},
                     {"tolerance", "m of ground points from the surface; 0: by their scatter"},
                     {"keep_classes", "ASPRS classes that keep theirs"},
                     {"overwrite", CAMBER_DOC(TilePlanOptions, overwrite)}})
          .c_str());
  module.def(
      "run_tiles",
      [](const fs::path& folder, const std::string& job_name, const fs::path& out, double radius,
         double voxel, std::optional<int> neighbors, double max_slope, double inlier_threshold,
         int min_patch_points, double tolerance_sigmas, double tolerance, const fs::path& patches,
         const fs::path& truth, const std::vector<double>& thresholds,
         const std::optional<std::size_t>& tile,
         const std::optional<std::pair<std::size_t, std::size_t>>& shard, std::uint64_t seed,
         int threads, const py::object& progress) {
        TileJob job = job_of(job_name, out);
        job.radius = radius;
        job.voxel = voxel;
        job.neighbors = neighbors.value_or(default_neighbors(job.kind));
        job.surface.seed = seed;
        job.surface.num_threads = threads;
        job.surface.max_slope = max_slope;
        job.surface.inlier_threshold = inlier_threshold;
        job.surface.min_patch_points = min_patch_points;
        job.surface.tolerance_sigmas = tolerance_sigmas;
        job.surface.tolerance = tolerance;
        job.patches = patches;
        job.truth = truth;
        job.thresholds = thresholds;
        job.num_threads = threads;
        if (job.kind == TileJob::Kind::kCompare && truth.empty()) {
          throw std::invalid_argument("truth: found none, expected the folder of another plan");
        }
        job.validate();
        const TilePlan read = read_tile_plan(folder);
        const std::vector<std::size_t> tiles = chosen(read, tile, shard);
        const Progress report = to_progress(progress);
        const TilesRun run = compute([&] { return run_tile_job(read, job, tiles, report); });
        py::dict done;
        done["out"] = job_folder(read, job);
        done["tiles"] = tiles.size();
        done["done_before"] = run.done_before;
        done["points"] = run.points;
        done["counts"] = run.counts;
        return done;
      },
      py::arg("plan"), py::arg("job"), py::kw_only(), py::arg("out") = "", py::arg("radius") = 0.0,
      py::arg("voxel") = 0.0, py::arg("neighbors") = py::none(),
      py::arg("max_slope") = defaults.surface.max_slope,
      py::arg("inlier_threshold") = defaults.surface.inlier_threshold,
      py::arg("min_patch_points") = defaults.surface.min_patch_points,
      py::arg("tolerance_sigmas") = defaults.surface.tolerance_sigmas,
      py::arg("tolerance") = defaults.surface.tolerance, py::arg("patches") = "",
      py::arg("truth") = "", py::arg("thresholds") = defaults.thresholds,
      py::arg("tile") = py::none(), py::arg("shard") = py::none(),
      py::arg("seed") = defaults.surface.seed, py::arg("threads") = 0,
      py::arg("progress") = py::none(),
      with_keywords("Works on the tiles of a plan; those that are done are passed over.",
                    {{"plan", "folder of plan_tiles()"},
                     {"job",
                      "'ground', 'filter', 'voxels', 'normals', 'patches', 'labels' (once patches "
                      "are joined) or 'compare'"},
                     {"out", "folder of the results; '': PLAN/JOB"},
                     {"radius", CAMBER_DOC(TileJob, radius)},
                     {"voxel", CAMBER_DOC(TileJob, voxel)},
                     {"neighbors", CAMBER_DOC(TileJob, neighbors)},
                     {"max_slope", "of patches, with the four below: as of fit_road_surface()"},
                     {"patches", CAMBER_DOC(TileJob, patches)},
                     {"truth", CAMBER_DOC(TileJob, truth)},
                     {"thresholds", CAMBER_DOC(TileJob, thresholds)},
                     {"tile", "one tile, by its number"},
                     {"shard", "(i, n): part i, from 1, of n"}})
          .c_str());
  module.def(
      "join_tiles",
      [](const fs::path& folder, const std::string& job_name, const fs::path& out,
         const py::object& driven_line, const std::string& consistency, double link_distance,
         int threads) {
        TileJob job = job_of(job_name, out);
        const TilePlan read = read_tile_plan(folder);
        if (job.kind == TileJob::Kind::kPatches) {
          job.surface.num_threads = threads;
          if (!driven_line.is_none()) {
            job.surface.driven_line = to_points(driven_line, "driven_line");
          }
          job.surface.consistency.consistency = consistency_of(consistency);
          job.surface.consistency.link_distance = link_distance;
          job.surface.validate();
          return joined_patches(read, job);
        }
        const JoinedTiles joined = compute([&] { return join_tiles(read, job); });
        py::dict done;
        done["index"] = joined.index;
        done["tiles"] = joined.tiles.size();
        done["points"] = joined.points;
        done["counts"] = joined.counts;
        return done;
      },
      py::arg("plan"), py::arg("job"), py::kw_only(), py::arg("out") = "",
      py::arg("driven_line") = py::none(), py::arg("consistency") = "continuity",
      py::arg("link_distance") = defaults.surface.consistency.link_distance, py::arg("threads") = 0,
      with_keywords("Checks that each tile of a plan is done and writes one index; of patches "
                    "joins the pieces to one surface, in surface.json and run.json.",
                    {{"plan", "folder of plan_tiles()"},
                     {"job", "as of run_tiles()"},
                     {"out", "as of run_tiles()"},
                     {"driven_line", "of patches, with the two below: as of fit_road_surface()"}})
          .c_str());
}

}  // namespace camber::python
