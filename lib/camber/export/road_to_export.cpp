#include "camber/export/road_to_export.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/export/crg_strip.h"
#include "camber/scene/georeference.h"
#include "camber/scene/results.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kFinest = 0.1;         // m, steps over patches, which are planes
constexpr double kScatters = 5.0;       // standard deviations that no point of a line is off by
constexpr double kMostTolerance = 0.3;  // m, unless more is asked for
constexpr double kSupport = 10.0;       // m beside the road whose points may count for its edge

/// The definition of the system that a result's cloud states; empty where it states none.
std::string system_of_cloud(const fs::path& cloud) {
  if (cloud.empty()) return {};
  const std::optional<CoordinateSystem> crs = open_point_source(cloud)->header().crs;
  if (!crs) return {};
  return crs->epsg != 0 ? fmt::format("EPSG:{}", crs->epsg) : crs->wkt;
}

/// Steps for the heights of patches: as fine as their points lie, but not finer than planes need.
double surface_step(const fs::path& cloud, const PlanFrame& frame) {
  if (cloud.empty()) return grid_step(0.0);
  const CloudFile file = read_cloud_file(cloud);
  return std::max(grid_step(cloud_heights(file.cloud, frame)->resolution()), kFinest);
}

/// The place on the map that the run beside a surface states.
std::optional<GeoReference> map_beside(const fs::path& surface_file) {
  const fs::path run = surface_file.parent_path() / "run.json";
  std::error_code ignored;
  if (!fs::exists(run, ignored)) return std::nullopt;
  return georeference_of(read_run(run), run);
}

std::vector<Eigen::Vector3d> in_plan(const PlanFrame& frame, std::vector<Eigen::Vector3d> line) {
  for (Eigen::Vector3d& place : line) place = frame.to_plan(place);
  return line;
}

/// The rectangle around a cloud's finite points, plan frame.
std::vector<Eigen::Vector3d> extent_of(const RoadCloud& cloud, const PlanFrame& frame) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : cloud.points) {
    if (p.allFinite()) box.extend(frame.to_plan(cloud.origin + p.cast<double>()));
  }
  if (box.isEmpty()) return {};
  const Eigen::Vector3d a = box.min(), b = box.max();
  return {a, {b.x(), a.y(), a.z()}, b, {a.x(), b.y(), a.z()}};
}

}  // namespace

std::string line_frame(const RoadSurface& surface) {
  return surface.frame == "camera" ? "the result's frame: its reference camera's, x right, y down, "
                                     "z forward, m, not the map's"
                                   : "the coordinates of the cloud that the result is made of, m";
}

fs::path cloud_of_result(const fs::path& surface_file) {
  std::error_code error;
  for (const char* const name : {"road.ply", "labels.ply"}) {
    fs::path path = surface_file.parent_path() / name;
    if (fs::exists(path, error)) return path;
  }
  return {};
}

RoadToExport road_of_surface(const fs::path& surface_file, const RoadSurface& surface,
                             const std::vector<Eigen::Vector3d>& line, double reach) {
  if (!surface.metric) {
    throw NoAnswerError(surface_file.string() +
                        ": the result is up to an unknown scale, and roads for other programs are "
                        "in metres");
  }
  RoadToExport out;
  const fs::path cloud = cloud_of_result(surface_file);
  out.frame = PlanFrame(surface.up);
  if (const std::optional<GeoReference> map = map_beside(surface_file)) {
    out.frame = PlanFrame(map->map_from_reference);
    out.geo_reference = map->crs;
    out.on_map = true;
  } else if (surface.frame != "camera") {
    out.geo_reference = system_of_cloud(cloud);
  }
  out.ground = surface_heights(surface, out.frame, reach);
  out.line = in_plan(out.frame, line);
  if (out.line.size() < 2) {
    throw NoAnswerError(surface_file.string() +
                        ": holds no driven line; give a line with --along FILE");
  }
  out.line_frame = line_frame(surface);
  for (const PlanePatch& patch : surface.patches) {
    out.outlines.push_back(in_plan(out.frame, patch.boundary));
  }
  out.files = {surface_file};
  if (out.on_map) out.files.push_back(surface_file.parent_path() / "run.json");
  if (!cloud.empty()) out.files.push_back(cloud);
  out.level = to_string(surface.level);
  out.described = fmt::format("frame of the result: {}, level: {}",
                              out.geo_reference.empty() ? surface.frame : out.geo_reference,
                              to_string(surface.level));
  out.step = surface_step(cloud, out.frame);
  return out;
}

RoadToExport road_of_cloud(const RoadCloud& cloud, const Eigen::Vector3d& up,
                           const std::vector<Eigen::Vector3d>& line, bool heights,
                           const RoadExtent& extent) {
  RoadToExport out;
  out.frame = PlanFrame(up);
  out.line = in_plan(out.frame, line);
  const bool level = out.frame.turned(Eigen::Vector3d::UnitZ()).isApprox(Eigen::Vector3d::UnitZ());
  if (level && !heights) {
    for (Eigen::Vector3d& place : out.line) place.z() = std::nan("");
  }
  const PlanCorridor where = corridor_of(out.line, extent);
  out.ground = cloud_heights(cloud, out.frame, &where);
  out.level = cloud.frame == CloudFrame::kCamera ? "camera" : "map";
  out.line_frame = "the cloud's coordinates";
  out.outlines = {extent_of(cloud, out.frame)};
  out.described = "heights of a cloud's points";
  return out;
}

std::string described(const RoadToExport& road) {
  std::string out = fmt::format(
      "Road surface, exported by Camber {}\n{}\n"
      "x, y, z of this file from that frame, row by row:\n",
      kVersion, road.described);
  for (int row = 0; row < 3; ++row) {
    const Eigen::RowVector3d r = road.frame.plan_from_surface.row(row);
    out += fmt::format("  {:.12f} {:.12f} {:.12f}\n", r.x(), r.y(), r.z());
  }
  if (!road.frame.shift.isZero()) {
    const Eigen::Vector3d& t = road.frame.shift;
    out += fmt::format("then shifted by\n  {:.4f} {:.4f} {:.4f}\n", t.x(), t.y(), t.z());
  }
  return out;
}

PlanCorridor corridor_of(const std::vector<Eigen::Vector3d>& line, const RoadExtent& extent) {
  const double widest = std::max({extent.widest, extent.left, extent.right});
  return corridor_along(SmoothLine(line, extent.tolerance, 0.0, extent.ahead), widest + kSupport);
}

double line_tolerance(const std::vector<Eigen::Vector3d>& line, double least) {
  return std::max(least, std::min(kScatters * line_scatter(line), kMostTolerance));
}

}  // namespace camber
