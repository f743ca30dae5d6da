#pragma once

#include <Eigen/Core>
#include <cmath>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/stopwatch.h"
#include "camber/road/fit_road_surface.h"
#include "cloud_arguments.h"
#include "command.h"

namespace camber::tools {

/// --up and --viewpoint of the commands on road clouds.
struct UpArguments {
  std::vector<double> up_values;
  std::vector<double> viewpoint_values;

  /// The direction given, else the cloud's own.
  Eigen::Vector3d up(const RoadCloud& cloud) const;
  std::optional<Eigen::Vector3d> viewpoint() const;
};

/// `arguments` must live as long as the app.
void add_up_arguments(App& app, UpArguments& arguments);

/// What `plane` and `patches` have in common: a cloud and how to look at it.
struct RoadCloudArguments {
  std::string cloud;
  CloudArguments reading;
  UpArguments up;
  bool as_json = false;

  /// Reads the cloud, in metres; warns of what its reader remarked.
  CloudFile read(const CommonOptions& common) const;
  /// @param labelled_later  see read_labelled_points()
  CloudFile read(const CommonOptions& common, const ReadOptions& options,
                 bool labelled_later = false) const;
};

/// Adds the cloud, --up, --viewpoint, --threshold (metres, 0: none), how to read the cloud, and
/// --json. The references must live as long as the app.
void add_road_cloud_arguments(App& app, RoadCloudArguments& arguments, double& threshold);

/// How a cloud is cut into patches, and what joins them: of `patches` and of tiles.
struct SurfaceArguments {
  RoadSurfaceOptions options;
  double max_slope_deg = 180.0 / M_PI * RoadSurfaceOptions().max_slope;
  std::string line, consistency = "continuity";

  /// With the driven line read. @throws std::invalid_argument
  RoadSurfaceOptions in_force(const CommonOptions& common) const;
};

/// The surface of a result folder or a surface.json; of a folder with a surface in tiles that part
/// of it which a line, where there is one, may touch. @param reach  m  @throws InputError
/// @param file  set to the surface.json
RoadSurface read_surface_along(const std::string& input, const std::vector<Eigen::Vector3d>& line,
                               double reach, std::filesystem::path* file);

/// --max-slope-deg, --min-points, --tolerance, --tolerance-sigmas; must live as long as the app.
void add_segment_arguments(App& app, SurfaceArguments& arguments);
/// --driven-line, --consistency, --link-distance; the same.
void add_graph_arguments(App& app, SurfaceArguments& arguments);

/// The points of a file (any cloud format, in their order) as a polyline.
/// @throws InputError if it cannot be read; NoAnswerError for fewer than two points.
/// @param system  of a file that states none.
std::vector<Eigen::Vector3d> read_line(
    const std::string& path, const std::optional<CoordinateSystem>& system = std::nullopt);

/// Why nothing is known along a line: how far its points are from the outlines of the ground, and
/// in which frame it is expected; empty where one of them is inside.
/// @param line, outlines  m, x and y level
std::string remark_on_line(const std::vector<Eigen::Vector3d>& line,
                           const std::vector<std::vector<Eigen::Vector3d>>& outlines,
                           const std::string& frame);

/// take_as_road() for a line that a user gives, with a warning.
void take_line_as_road(const std::string& path, const std::vector<Eigen::Vector3d>& line,
                       double reach, const LogSink& warn, RoadSurface* surface);

/// The surface of a result folder of `reconstruct`: in the reference camera's frame.
/// @throws InputError if it cannot be read or is in another frame.
RoadSurface read_camera_surface(const std::string& folder);

}  // namespace camber::tools
