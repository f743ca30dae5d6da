// plan_tiles, run_tiles and join_tiles: clouds larger than memory.

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/cloud/units.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/import/maps/proj_systems.h"
#include "camber/scene/results.h"
#include "camber/tiles/join_profile.h"
#include "camber/tiles/plan_tiles.h"
#include "camber/tiles/tile_job.h"
#include "convert.h"
#include "running.h"

namespace fs = std::filesystem;

namespace camber::python {
namespace {

/// What a parameter crs names; nothing where it is empty.
std::optional<CoordinateSystem> system_named(const std::string& crs) {
  if (crs.empty()) return std::nullopt;
  CoordinateSystem system;
  std::string reason;
  if (!system_of_definition(crs, find_coordinate_system, &system, &reason)) {
    throw std::invalid_argument("crs: found '" + crs.substr(0, 80) + "': " + reason);
  }
  return system;
}

py::dict planned(const std::vector<fs::path>& clouds, const fs::path& out, TilePlanOptions options,
                 const std::string& crs, const py::object& progress) {
  if (clouds.empty()) throw std::invalid_argument("clouds: found none, expected files");
  if (const auto system = system_named(crs)) options.crs = system;
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
  job.folder = out;
  return job;
}

TileGroundFrom ground_from_of(const std::string& name) {
  if (name == "job") return TileGroundFrom::kJob;
  if (name == "class") return TileGroundFrom::kClass;
  if (name == "all") return TileGroundFrom::kAll;
  throw std::invalid_argument("ground_from: found '" + name +
                              "', expected 'job', 'class' or 'all'");
}

/// The line of profiles, N x 2 or N x 3 in the tiles' coordinates and units, in metres: as the
/// program has it of a file, bit for bit, so that either goes on where the other stopped.
std::vector<Eigen::Vector3d> line_of(const TilePlan& plan, const py::object& value) {
  if (value.is_none()) throw std::invalid_argument("line: found none, expected N x 2 or N x 3");
  using Rows = py::array_t<double, py::array::c_style | py::array::forcecast>;
  std::vector<Eigen::Vector3d> line;
  const Rows rows = Rows::ensure(value);
  if (rows && rows.ndim() == 2 && rows.shape(1) == 2) {
    for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
      line.emplace_back(rows.at(i, 0), rows.at(i, 1), 0.0);
    }
  } else {
    line = to_points(value, "line");
  }
  for (const Eigen::Vector3d& place : line) {
    if (place.head<2>().allFinite()) continue;
    throw std::invalid_argument("line: found a place that is not finite, expected numbers");
  }
  check_tile_line("line", &line);
  RoadCloud cloud = cloud_from_points(
      Rows({static_cast<py::ssize_t>(line.size()), py::ssize_t{3}}, line[0].data()), "line");
  CoordinateSystem units;
  units.horizontal.metres = plan.metres;
  units.vertical.metres = plan.height_metres;
  to_metres(&cloud, units);
  for (std::size_t i = 0; i < line.size(); ++i) {
    line[i] = cloud.origin + cloud.points[i].cast<double>();
  }
  return line;
}

/// kExport: what GDAL and PROJ do.
void prepare_rasters(const TilePlan& plan, const std::string& crs, TileJob* job) {
  // Shared: copies of the job are made where the interpreter's lock is released.
  const auto write = std::make_shared<py::object>(gdal_function("write_cloud_optimized"));
  job->write_raster = [write](const RawRaster& raster, const std::string& definition,
                              const std::map<std::string, std::string>& metadata,
                              const std::string& out) {
    const py::gil_scoped_acquire lock;
    std::vector<std::pair<std::string, std::string>> bands;
    for (const RasterBand& band : raster.bands) bands.emplace_back(band.name, band.unit);
    const SiteGrid& grid = raster.grid;
    (*write)(raster.file, bands, std::array<double, 3>{grid.west, grid.north, grid.cell},
             std::array<std::size_t, 2>{grid.columns, grid.rows}, raster.name, definition, metadata,
             out);
  };
  const auto system = system_of_tiles(plan, system_named(crs), find_coordinate_system);
  if (system) set_raster_system(plan, *system, job);
}

/// One Cloud Optimized GeoTIFF of all tiles.
void write_mosaic(const TilePlan& plan, const TileJob& job, const fs::path& out) {
  AtomicFiles files;
  gdal_function("copy_cloud_optimized")(mosaic_path(plan, job).string(), out.string(),
                                        files.stage(out).string());
  files.commit();
}

/// One profile out of the points that tiles have left, with its files.
py::dict joined_profile(const TilePlan& plan, TileJob job, const CloudProfileOptions& options,
                        const std::optional<CoordinateSystem>& crs) {
  JoinedProfile joined = compute([&] {
    const RoadCloud cloud = read_profile_points(plan, crs, find_coordinate_system, &job);
    JoinedProfile out = join_profile(plan, job, cloud, options);
    write_profile(plan, job, out, "", 0);
    return out;
  });
  py::dict done;
  done["csv"] = job_folder(plan, job) / "profile.csv";
  done["ground_points"] = joined.ground.points.size();
  done["noise"] = joined.profile.noise;
  done["density"] = joined.profile.density;
  done["stations"] = std::move(joined.profile.stations);
  return done;
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
  const CloudProfileOptions profile;
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
         const fs::path& truth, const std::vector<double>& thresholds, const fs::path& ground,
         const std::string& ground_from, double step, double fill_holes, const py::object& line,
         double half_width, const std::string& crs, const std::optional<std::size_t>& tile,
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
        job.ground = ground;
        job.ground_from = ground_from_of(ground_from);
        job.step = step;
        job.fill_holes = fill_holes;
        job.half_width = half_width;
        job.num_threads = threads;
        if (job.kind == TileJob::Kind::kCompare && truth.empty()) {
          throw std::invalid_argument("truth: found none, expected the folder of another plan");
        }
        job.validate();
        const TilePlan read = read_tile_plan(folder);
        const std::vector<std::size_t> tiles = chosen(read, tile, shard);
        if (job.kind == TileJob::Kind::kExport) prepare_rasters(read, crs, &job);
        if (job.kind == TileJob::Kind::kProfile) job.line = line_of(read, line);
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
      py::arg("truth") = "", py::arg("thresholds") = defaults.thresholds, py::arg("ground") = "",
      py::arg("ground_from") = "job", py::arg("step") = defaults.step,
      py::arg("fill_holes") = defaults.fill_holes, py::arg("line") = py::none(),
      py::arg("half_width") = defaults.half_width, py::arg("crs") = "",
      py::arg("tile") = py::none(), py::arg("shard") = py::none(),
      py::arg("seed") = defaults.surface.seed, py::arg("threads") = 0,
      py::arg("progress") = py::none(),
      with_keywords("Works on the tiles of a plan; those that are done are passed over.",
                    {{"plan", "folder of plan_tiles()"},
                     {"job",
                      "'ground', 'filter', 'voxels', 'normals', 'patches', 'labels' (once patches "
                      "are joined), 'compare', 'export' or 'profile' (once ground is joined)"},
                     {"out", "folder of the results; '': PLAN/JOB"},
                     {"radius", CAMBER_DOC(TileJob, radius)},
                     {"voxel", CAMBER_DOC(TileJob, voxel)},
                     {"neighbors", CAMBER_DOC(TileJob, neighbors)},
                     {"max_slope", "of patches, with the four below: as of fit_road_surface()"},
                     {"patches", CAMBER_DOC(TileJob, patches)},
                     {"truth", CAMBER_DOC(TileJob, truth)},
                     {"thresholds", CAMBER_DOC(TileJob, thresholds)},
                     {"ground", CAMBER_DOC(TileJob, ground)},
                     {"ground_from",
                      "of export and profile: 'job', the joined ground; 'class', 2 and 11 of the "
                      "plan's tiles; 'all', every point of them but water"},
                     {"step", CAMBER_DOC(TileJob, step)},
                     {"fill_holes", CAMBER_DOC(TileJob, fill_holes)},
                     {"line", "of profile: N x 2 or N x 3, in the tiles' coordinates and units"},
                     {"half_width", CAMBER_DOC(TileJob, half_width)},
                     {"crs", "of export: of the tiles, in place of what they state"},
                     {"tile", "one tile, by its number"},
                     {"shard", "(i, n): part i, from 1, of n"}})
          .c_str());
  module.def(
      "join_tiles",
      [](const fs::path& folder, const std::string& job_name, const fs::path& out,
         const py::object& driven_line, const std::string& consistency, double link_distance,
         const py::object& line, double step, double length, bool crown, const std::string& crs,
         const fs::path& cog, int threads) {
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
        const bool raster = job.kind == TileJob::Kind::kExport;
        if (!cog.empty() && !raster) {
          throw std::invalid_argument("cog: found job '" + job_name + "', expected 'export'");
        }
        check_output_file(cog);
        py::dict done;
        if (job.kind == TileJob::Kind::kProfile) {
          CloudProfileOptions options;
          options.profile.step = step;
          options.profile.length = length;
          options.crown = crown;
          options.num_threads = threads;
          options.validate();
          job.line = line_of(read, line);
          done = joined_profile(read, job, options, system_named(crs));
        }
        const JoinedTiles joined = compute([&] { return join_tiles(read, job); });
        if (raster) done["mosaic"] = mosaic_path(read, job);
        if (!cog.empty()) write_mosaic(read, job, cog);
        done["index"] = joined.index;
        done["tiles"] = joined.tiles.size();
        done["points"] = joined.points;
        done["counts"] = joined.counts;
        return done;
      },
      py::arg("plan"), py::arg("job"), py::kw_only(), py::arg("out") = "",
      py::arg("driven_line") = py::none(), py::arg("consistency") = "continuity",
      py::arg("link_distance") = defaults.surface.consistency.link_distance,
      py::arg("line") = py::none(), py::arg("step") = profile.profile.step,
      py::arg("length") = profile.profile.length, py::arg("crown") = profile.crown,
      py::arg("crs") = "", py::arg("cog") = "", py::arg("threads") = 0,
      with_keywords("Checks that each tile of a plan is done and writes one index; of patches "
                    "joins the pieces to one surface, in surface.json and run.json; of export "
                    "writes mosaic.vrt; of profile measures along the line, in profile.csv, "
                    "profile.json and `stations`.",
                    {{"plan", "folder of plan_tiles()"},
                     {"job", "as of run_tiles()"},
                     {"out", "as of run_tiles()"},
                     {"driven_line", "of patches, with the two below: as of fit_road_surface()"},
                     {"line", "of profile: that of run_tiles()"},
                     {"step", CAMBER_DOC(ProfileOptions, step)},
                     {"length", CAMBER_DOC(ProfileOptions, length)},
                     {"crown", CAMBER_DOC(CloudProfileOptions, crown)},
                     {"crs", "of profile: of the tiles, in place of what they state"},
                     {"cog", "of export: also one Cloud Optimized GeoTIFF of all, a file"}})
          .c_str());
}

}  // namespace camber::python
