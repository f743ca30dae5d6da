#include "tile_products.h"

#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/tiles/join_profile.h"
#include "crs.h"
#include "gdal_functions.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

std::optional<CoordinateSystem> given_system(const std::string& crs) {
  if (crs.empty()) return std::nullopt;
  return crs_from_option(crs);
}

}  // namespace

void prepare_rasters(const TilePlan& plan, const std::string& crs, TileJob* job) {
  job->write_raster = gdal_functions().write_cloud_optimized;
  const auto system = system_of_tiles(plan, given_system(crs), look_up_crs);
  if (system) set_raster_system(plan, *system, job);
}

void write_mosaic(const TilePlan& plan, const TileJob& job, const std::string& out) {
  const fs::path mosaic = mosaic_path(plan, job);
  AtomicFiles files;
  gdal_functions().copy_cloud_optimized(mosaic.string(), out, files.stage(out).string());
  throw_if_interrupted();
  files.commit();
}

std::vector<Eigen::Vector3d> read_tile_line(const TilePlan& plan, const TileLine& line,
                                            const LogSink& warn) {
  if (line.file.empty()) {
    throw UsageError("--job profile: expected --along beside it: the line along which to measure");
  }
  std::vector<Eigen::Vector3d> out = read_along(
      line.file, line.reading, system_of_tiles(plan, given_system(line.crs), look_up_crs), warn);
  check_tile_line(line.file, &out);
  return out;
}

json join_profile(const Command& command, const TilePlan& plan, TileJob job, const TileLine& line,
                  CloudProfileOptions options, Timings* timings) {
  StageTimer load(*timings, "load");
  job.line = read_tile_line(plan, line, make_warning_sink(command.common));
  const RoadCloud cloud = read_profile_points(plan, given_system(line.crs), look_up_crs, &job);
  load.stop();
  throw_if_interrupted();
  StageTimer compute(*timings, "compute");
  options.num_threads = command.common.threads;
  JoinedProfile joined;
  try {
    joined = camber::join_profile(plan, job, cloud, options);
  } catch (const std::invalid_argument& error) {
    throw UsageError(std::string("--") + error.what());
  }
  compute.stop();
  StageTimer write(*timings, "write");
  json result = write_profile(plan, job, joined, line.file, command.common.seed);
  write.stop();
  result.erase("stations");
  result["station_count"] = joined.profile.stations.size();
  return result;
}

}  // namespace camber::tools
