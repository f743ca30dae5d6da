#include "tile_products.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/scene/results.h"
#include "cloud_arguments.h"
#include "crs.h"
#include "gdal_functions.h"
#include "ground_points.h"
#include "own_inputs.h"
#include "profile_table.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

/// As the tiles state it, or as it is given for them.
std::optional<CoordinateSystem> system_of(const TilePlan& plan, const std::string& crs) {
  ReadOptions reading;
  if (!crs.empty()) reading.crs = crs_from_option(crs);
  std::optional<CoordinateSystem> out = open_point_source(plan.path_of(0), reading)->header().crs;
  if (out) complete_crs(&*out);
  return out;
}

/// Points that tiles have left, in metres.
RoadCloud read_points_near_line(const std::vector<fs::path>& files, const std::string& crs) {
  ReadOptions reading;
  reading.attributes = {"classification", "class_flags"};
  if (!crs.empty()) reading.crs = crs_from_option(crs);
  RoadCloud out;
  for (const fs::path& path : files) {
    throw_if_interrupted();
    CloudFile file = read_cloud_file(path, reading);
    use_metres(path.string(), &file, {});
    RoadCloud& part = file.cloud;
    if (out.empty()) {
      out = std::move(part);
      continue;
    }
    const Eigen::Vector3d shift = part.origin - out.origin;
    if (!shift.isZero(0.0)) {
      for (Eigen::Vector3f& point : part.points) {
        point = (shift + point.cast<double>()).cast<float>();
      }
    }
    out.points.insert(out.points.end(), part.points.begin(), part.points.end());
    for (auto& [name, labels] : out.labels) {
      const auto found = part.labels.find(name);
      if (found == part.labels.end()) {
        throw InputError(path.string(), "found no " + name + ", which other tiles have");
      }
      labels.insert(labels.end(), found->second.begin(), found->second.end());
    }
  }
  return out;
}

}  // namespace

void prepare_rasters(const TilePlan& plan, const std::string& crs, TileJob* job) {
  job->write_raster = gdal_functions().write_cloud_optimized;
  const std::optional<CoordinateSystem> system = system_of(plan, crs);
  if (!system) return;
  if (system->horizontal.angle) {
    throw NoAnswerError(plan.path_of(0).string() + ": " + unit_remark(*system));
  }
  job->crs = definition_for_raster(*system);
  job->height_unit = height_unit_of(*system);
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
  std::vector<Eigen::Vector3d> out =
      read_along(line.file, line.reading, system_of(plan, line.crs), warn);
  for (Eigen::Vector3d& place : out) {
    if (std::isnan(place.z())) place.z() = 0.0;  // the way in plan counts
  }
  const bool moves = std::any_of(out.begin(), out.end(), [&](const Eigen::Vector3d& x) {
    return (x - out.front()).head<2>().norm() > 1e-9;
  });
  if (!moves) throw NoAnswerError(line.file + ": the line does not leave its first point");
  return out;
}

json join_profile(const Command& command, const TilePlan& plan, TileJob job, const TileLine& line,
                  CloudProfileOptions options, Timings* timings) {
  StageTimer load(*timings, "load");
  job.line = read_tile_line(plan, line, make_warning_sink(command.common));
  const std::vector<fs::path> files = profile_files(plan, &job);
  const fs::path folder = job_folder(plan, job);
  const RoadCloud cloud = read_points_near_line(files, line.crs);
  if (cloud.empty()) {
    throw NoAnswerError(folder.string() + ": no tile has ground near the line of " + line.file);
  }
  load.stop();
  throw_if_interrupted();
  StageTimer compute(*timings, "compute");
  options.half_width = job.half_width;
  options.num_threads = command.common.threads;
  const bool all = job.ground_from == TileGroundFrom::kAll;
  const GroundBesideLine ground =
      ground_beside_line(cloud, Eigen::Vector3d::UnitZ(), job.line, options.half_width,
                         all ? GroundSource::kAll : GroundSource::kClasses, options.num_threads);
  if (ground.status == Status::kFailed) throw NoAnswerError(folder.string() + ": " + ground.reason);
  CloudProfile profile;
  try {
    profile = profile_cloud(cloud, ground.points, Eigen::Vector3d::UnitZ(), job.line, options);
  } catch (const std::invalid_argument& error) {
    throw UsageError(std::string("--") + error.what());
  }
  if (profile.status == Status::kFailed) {
    throw NoAnswerError(folder.string() + ": " + profile.reason);
  }
  compute.stop();
  StageTimer write(*timings, "write");
  json result = sections_json(
      profile, options,
      {plan.folder.string(), line.file, name_of(ground.source), "gravity", cloud.metric, &ground},
      command.common);
  AtomicFiles outputs;
  write_file_atomically(outputs.stage(folder / "profile.csv"),
                        sections_csv(profile, cloud.metric, options.crown));
  write_json(result, outputs.stage(folder / "profile.json"));
  outputs.commit();
  write.stop();
  result.erase("stations");
  result["station_count"] = profile.stations.size();
  return result;
}

}  // namespace camber::tools
