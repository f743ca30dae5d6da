#include "camber/tiles/join_profile.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/units.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/export/profile_table.h"
#include "camber/scene/results.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// Behind the points of other tiles, in the frame of the first one's.
void append(const fs::path& path, RoadCloud part, RoadCloud* out) {
  if (out->empty()) {
    *out = std::move(part);
    return;
  }
  const Eigen::Vector3d shift = part.origin - out->origin;
  if (!shift.isZero(0.0)) {
    for (Eigen::Vector3f& point : part.points) {
      point = (shift + point.cast<double>()).cast<float>();
    }
  }
  out->points.insert(out->points.end(), part.points.begin(), part.points.end());
  for (auto& [name, labels] : out->labels) {
    const auto found = part.labels.find(name);
    if (found == part.labels.end()) {
      throw InputError(path.string(), "found no " + name + ", which other tiles have");
    }
    labels.insert(labels.end(), found->second.begin(), found->second.end());
  }
}

}  // namespace

void check_tile_line(const std::string& name, std::vector<Eigen::Vector3d>* line) {
  for (Eigen::Vector3d& place : *line) {
    if (std::isnan(place.z())) place.z() = 0.0;
  }
  const bool moves = std::any_of(line->begin(), line->end(), [&](const Eigen::Vector3d& x) {
    return (x - line->front()).head<2>().norm() > 1e-9;
  });
  if (!moves) throw NoAnswerError(name + ": the line does not leave its first point");
}

RoadCloud read_profile_points(const TilePlan& plan, const std::optional<CoordinateSystem>& crs,
                              const FindSystem& find, TileJob* job) {
  ReadOptions reading;
  reading.attributes = {"classification", "class_flags"};
  reading.crs = crs;
  RoadCloud out;
  for (const fs::path& path : profile_files(plan, job)) {
    throw_if_interrupted();
    CloudFile file = read_cloud_file(path, reading);
    if (file.report.crs) {
      complete_system(&*file.report.crs, find);
      if (file.report.crs->horizontal.angle) {
        file.cloud.metric = false;
      } else {
        to_metres(&file.cloud, *file.report.crs);
      }
    }
    append(path, std::move(file.cloud), &out);
  }
  if (out.empty()) {
    throw NoAnswerError(job_folder(plan, *job).string() + ": no tile has ground near the line");
  }
  return out;
}

JoinedProfile join_profile(const TilePlan& plan, const TileJob& job, const RoadCloud& cloud,
                           CloudProfileOptions options) {
  const std::string folder = job_folder(plan, job).string();
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  options.half_width = job.half_width;
  options.validate();
  JoinedProfile out;
  out.options = options;
  out.metric = cloud.metric;
  out.ground = ground_beside_line(
      cloud, up, job.line, options.half_width,
      job.ground_from == TileGroundFrom::kAll ? GroundSource::kAll : GroundSource::kClasses,
      options.num_threads);
  if (out.ground.status == Status::kFailed) throw NoAnswerError(folder + ": " + out.ground.reason);
  out.profile = profile_cloud(cloud, out.ground.points, up, job.line, options);
  if (out.profile.status == Status::kFailed) {
    throw NoAnswerError(folder + ": " + out.profile.reason);
  }
  return out;
}

nlohmann::json write_profile(const TilePlan& plan, const TileJob& job, const JoinedProfile& joined,
                             const std::string& along, std::uint64_t seed) {
  const fs::path folder = job_folder(plan, job);
  nlohmann::json out = sections_json(joined.profile, joined.options,
                                     {plan.folder.string(), along, to_string(joined.ground.source),
                                      "gravity", joined.metric, &joined.ground},
                                     seed);
  if (along.empty()) out["along"] = nullptr;
  AtomicFiles files;
  write_file_atomically(files.stage(folder / "profile.csv"),
                        sections_csv(joined.profile, joined.metric, joined.options.crown));
  write_json(out, files.stage(folder / "profile.json"));
  files.commit();
  return out;
}

}  // namespace camber
