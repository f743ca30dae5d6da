#include "road_arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/road/plan_polygon.h"
#include "camber/road/surface_lookup.h"
#include "camber/scene/results.h"
#include "camber/scene/surface_tiles.h"
#include "crs.h"
#include "unknown_scale.h"

namespace camber::tools {

Eigen::Vector3d UpArguments::up(const RoadCloud& cloud) const {
  if (up_values.empty()) return cloud.default_up();
  const Eigen::Vector3d direction(up_values[0], up_values[1], up_values[2]);
  if (!direction.allFinite() || !(direction.norm() > 0.0)) {
    throw UsageError("--up: found a vector without a direction, expected x,y,z");
  }
  return direction.normalized();
}

std::optional<Eigen::Vector3d> UpArguments::viewpoint() const {
  if (viewpoint_values.empty()) return std::nullopt;
  return Eigen::Vector3d(viewpoint_values[0], viewpoint_values[1], viewpoint_values[2]);
}

void add_up_arguments(App& app, UpArguments& arguments) {
  app.add_option("--up", arguments.up_values,
                 "up direction x,y,z; default: the camera's (0,-1,0) for clouds that Camber wrote "
                 "in a camera's frame, else 0,0,1")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--viewpoint", arguments.viewpoint_values,
                 "place x,y,z from which all points were seen: sigmas are then along the rays; "
                 "default: the origin for clouds in a camera's frame, else unknown")
      ->check(finite_number())
      ->delimiter(',')
      ->expected(3);
}

CloudFile RoadCloudArguments::read(const CommonOptions& common) const {
  return read(common, reading.read_options());
}

CloudFile RoadCloudArguments::read(const CommonOptions& common, const ReadOptions& options,
                                   bool labelled_later) const {
  CloudFile file =
      labelled_later ? read_labelled_points(cloud, options) : read_cloud_file(cloud, options);
  const LogSink warn = make_warning_sink(common);
  warn_about(cloud, file.report, warn);
  use_metres(cloud, &file, warn);
  warn_of_unknown_scale(cloud, file.cloud.metric, file.report.crs, warn);
  return file;
}

void add_road_cloud_arguments(App& app, RoadCloudArguments& arguments, double& threshold) {
  app.add_option("cloud", arguments.cloud, "PCD, PLY, KITTI .bin, LAS, LAZ or text")->required();
  add_up_arguments(app, arguments.up);
  app.add_option("--threshold", threshold,
                 "metres from a plane that make an inlier; 0: from the points' own uncertainty, or "
                 "from the noise of the cloud")
      ->capture_default_str();
  add_cloud_arguments(app, arguments.reading);
  app.add_flag("--json", arguments.as_json, "one JSON object on stdout");
}

std::vector<Eigen::Vector3d> read_line(const std::string& path,
                                       const std::optional<CoordinateSystem>& system) {
  CloudFile file = read_cloud_file(path);
  if (!file.report.crs) file.report.crs = system;
  use_metres(path, &file, {});
  const RoadCloud& cloud = file.cloud;
  std::vector<Eigen::Vector3d> line;
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    if (!p.allFinite()) {
      throw InputError(path, fmt::format("point {} of the line: found {} {} {}, expected finite "
                                         "coordinates",
                                         i + 1, p.x(), p.y(), p.z()));
    }
    line.push_back(cloud.origin + p.cast<double>());
  }
  if (line.size() < 2) {
    throw NoAnswerError(path + ": a line needs at least two points");
  }
  return line;
}

std::string remark_on_line(const std::vector<Eigen::Vector3d>& line,
                           const std::vector<std::vector<Eigen::Vector3d>>& outlines,
                           const std::string& frame) {
  double least = std::numeric_limits<double>::infinity();
  for (const std::vector<Eigen::Vector3d>& outline : outlines) {
    PlanPolygon polygon;
    for (const Eigen::Vector3d& x : outline) polygon.push_back(x.head<2>());
    for (const Eigen::Vector3d& x : line) {
      least = std::min(least, distance_to_polygon(polygon, x.head<2>()));
    }
  }
  if (!(least > 0.0) || !std::isfinite(least)) return {};
  return fmt::format(
      "; the nearest point of the line is {:.{}f} m from the known ground, expected a line in {}",
      least, least < 10.0 ? 2 : 0, frame);
}

void take_line_as_road(const std::string& path, const std::vector<Eigen::Vector3d>& line,
                       double reach, const LogSink& warn, RoadSurface* surface) {
  const std::vector<int> taken = take_as_road(line, reach, surface);
  if (taken.empty() || !warn) return;
  constexpr std::size_t kNamed = 8;
  std::string ids;
  for (std::size_t k = 0; k < std::min(kNamed, taken.size()); ++k) {
    ids += fmt::format("{}{}", k > 0 ? ", " : "", taken[k]);
  }
  if (taken.size() > kNamed) ids += fmt::format(" and {} more", taken.size() - kNamed);
  warn(fmt::format(
      "{}: the line lies on {} of kind other ({}), which {} taken as road; give "
      "patches the line by --driven-line for a surface that has it as its road",
      path, taken.size() > 1 ? "patches" : "a patch", ids, taken.size() > 1 ? "are" : "is"));
}

RoadSurface read_surface_along(const std::string& input, const std::vector<Eigen::Vector3d>& line,
                               double reach, std::filesystem::path* file) {
  *file = input;
  std::error_code ignored;
  const bool folder = std::filesystem::is_directory(*file, ignored);
  if (folder) *file = road_folder(*file) / "surface.json";
  if (!folder || line.empty() || !has_surface_tiles(file->parent_path())) {
    return read_surface(*file);
  }
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector3d& place : line) box.extend(Eigen::Vector2d(place.head<2>()));
  box.min().array() -= reach + 1.0;
  box.max().array() += reach + 1.0;
  return read_surface_within(file->parent_path(), box);
}

RoadSurface read_camera_surface(const std::string& folder) {
  const std::filesystem::path path = road_folder(folder) / "surface.json";
  RoadSurface surface = read_surface(path);
  if (surface.frame != "camera") {
    throw InputError(path.string(), "frame",
                     "found \"" + surface.frame + "\", expected \"camera\"");
  }
  return surface;
}

void add_segment_arguments(App& app, SurfaceArguments& arguments) {
  app.add_option("--max-slope-deg", arguments.max_slope_deg, "steepest ground, degrees from level")
      ->capture_default_str();
  app.add_option("--min-points", arguments.options.min_patch_points,
                 "patches on fewer points are dropped")
      ->capture_default_str();
  app.add_option("--tolerance", arguments.options.tolerance,
                 "metres that ground may bend away from its patch, at least")
      ->capture_default_str();
  app.add_option("--tolerance-sigmas", arguments.options.tolerance_sigmas,
                 "the same in standard deviations of a point, at least")
      ->capture_default_str();
}

void add_graph_arguments(App& app, SurfaceArguments& arguments) {
  app.add_option("--driven-line", arguments.line,
                 "points of the driven path in order (any cloud format): tells the road from other "
                 "ground, and ahead from behind");
  app.add_option("--consistency", arguments.consistency,
                 "continuity: neighbours meet at equal heights; paper: equation 8, alike normals "
                 "and offsets; none")
      ->check(is_member({"continuity", "paper", "none"}))
      ->capture_default_str();
  app.add_option("--link-distance", arguments.options.consistency.link_distance,
                 "metres within which patches are neighbours")
      ->capture_default_str();
}

RoadSurfaceOptions SurfaceArguments::in_force(const CommonOptions& common) const {
  static const std::map<std::string, Consistency> kConsistencies = {
      {"none", Consistency::kNone},
      {"paper", Consistency::kPaper},
      {"continuity", Consistency::kContinuity}};
  RoadSurfaceOptions out = options;
  out.seed = common.seed;
  out.num_threads = common.threads;
  out.max_slope = max_slope_deg * M_PI / 180.0;
  out.consistency.consistency = kConsistencies.at(consistency);
  if (!line.empty()) out.driven_line = read_line(line);
  out.validate();
  return out;
}

}  // namespace camber::tools
