#include "camber/drive/drive_surface.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/road/strip_surface.h"
#include "camber/scene/georeference.h"
#include "camber/scene/surface_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// The surface in another frame.
void turn(const SE3& b_from_a, RoadSurface* surface) {
  surface->up = b_from_a.rotation() * surface->up;
  for (PlanePatch& patch : surface->patches) {
    patch.plane = patch.plane.transformed(b_from_a);
    for (Eigen::Vector3d& x : patch.boundary) x = b_from_a * x;
  }
  for (Eigen::Vector3d& x : surface->driven_line) x = b_from_a * x;
}

RoadCloud cloud_of(const RoadStrip& strip, const SE3& world_from_strip,
                   const std::vector<int>& patch_of_cell, bool metric) {
  RoadCloud out;
  out.frame = CloudFrame::kCamera;
  out.metric = metric;
  if (!strip.cells.empty()) {
    const Eigen::Vector3d first = world_from_strip * strip.cells.front().point;
    out.origin = {std::round(first.x()), std::round(first.y()), std::round(first.z())};
  }
  for (const StripCell& cell : strip.cells) {
    out.points.push_back((world_from_strip * cell.point - out.origin).cast<float>());
    out.colors.push_back(cell.color);
    out.sigmas.push_back(static_cast<float>(cell.sigma));
  }
  out.labels["patch"] = patch_of_cell;
  return out;
}

/// How well gravity is known: the frames' instrument is one, and so is its error.
double level_sigma(const Scene& scene, const DriveResult& result) {
  if (!result.level_by_gravity) return 0.0;
  double out = 0.0;
  for (const TrajectoryPose& pose : result.trajectory.poses) {
    const SceneFrame* frame = scene.find_frame(pose.frame);
    if (frame && frame->up) out = std::max(out, frame->up_sigma);
  }
  return out;
}

}  // namespace

DriveSurface drive_surface(const Scene& scene, const DriveResult& result,
                           const fs::path& scene_path, std::uint64_t seed) {
  DriveSurface out;
  StripPatches where;
  out.surface = strip_surface(result.strip, {}, &where);
  out.stations = where.stations;
  const SE3 world_from_strip = result.strip.strip_from_world.inverse();
  turn(world_from_strip, &out.surface);
  out.surface.frame = "camera";
  out.surface.metric = result.trajectory.metric;
  out.surface.scale_sigma = result.trajectory.common_sigma;
  out.surface.level =
      result.level_by_gravity ? RoadSurface::Level::kGravity : RoadSurface::Level::kCamera;
  out.surface.level_sigma = level_sigma(scene, result);
  out.cloud = cloud_of(result.strip, world_from_strip, where.of_cell, result.trajectory.metric);
  out.run.seed = seed;
  out.run.metric = result.trajectory.metric;
  out.run.scale_sigma = result.trajectory.common_sigma;
  out.run.scene = scene_path.string();
  for (const DriveFrame& frame : result.document.frames) {
    if (frame.world_from_camera) out.run.cameras.push_back({frame.id, *frame.world_from_camera});
  }
  out.run.points_kept.emplace_back("road", static_cast<long>(out.cloud.size()));
  put_georeference(scene, out.surface, &out.run);
  return out;
}

void write_drive_surface(const DriveSurface& road, const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  write_cloud(road.cloud, folder / "road.ply");
  write_surface(road.surface, folder / "surface.json");
  write_json(to_json(road.run), folder / "run.json");
}

}  // namespace camber
