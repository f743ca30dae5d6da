#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/export/height_source.h"
#include "camber/export/plan_frame.h"
#include "camber/export/smooth_line.h"
#include "camber/road/road_surface.h"

namespace camber {

/// A road as its exports take it: the ground, and the line along which it is wanted.
struct RoadToExport {
  PlanFrame frame;
  std::unique_ptr<HeightSource> ground;
  std::vector<Eigen::Vector3d> line;                   ///< m, plan frame; z NaN: on the ground
  std::string line_frame;                              ///< in which the line was given
  std::vector<std::vector<Eigen::Vector3d>> outlines;  ///< m, plan frame, of the ground
  std::string level;          ///< "gravity" or "camera" of a result; "map" of a cloud that is z-up
  std::string described;      ///< for comments in files
  std::string geo_reference;  ///< code or text of the coordinate system; empty: not known
  bool on_map = false;        ///< a result that its run places on a map
  double step = 0.0;          ///< m, of grids over a result's patches; 0: from the data
  std::vector<std::filesystem::path> files;  ///< that were read
};

/// How much of the line and of what lies beside it is taken.
struct RoadExtent {
  double tolerance = 0.02;         ///< m that the smooth line may pass a point by
  double ahead = 60.0;             ///< m to go on straight while ground is seen
  double left = 0.0, right = 0.0;  ///< m to either side; 0: as far as is seen
  double widest = 12.0;            ///< m, limit of what is seen
};

/// "the result's frame ..." for messages about a line.
std::string line_frame(const RoadSurface& surface);

/// The cloud that a result holds or was made of; empty where there is none.
/// @param surface_file  its surface.json.
std::filesystem::path cloud_of_result(const std::filesystem::path& surface_file);

/// The road of a result along a line: on the map, where its run.json has a place there.
/// @param line   m, the result's frame.
/// @param reach  m that a place may lie beyond a patch's boundary.
/// @throws NoAnswerError for a surface that is not metric, or without a line.
RoadToExport road_of_surface(const std::filesystem::path& surface_file, const RoadSurface& surface,
                             const std::vector<Eigen::Vector3d>& line, double reach);

/// The road of a cloud in metres along a line.
/// @param up       in the cloud's frame.
/// @param line     m, the cloud's frame.
/// @param heights  whether the line's z are heights; false, of a cloud that is z-up: it lies on the
///                 ground.
/// @throws std::invalid_argument for a line that leads nowhere.
RoadToExport road_of_cloud(const RoadCloud& cloud, const Eigen::Vector3d& up,
                           const std::vector<Eigen::Vector3d>& line, bool heights,
                           const RoadExtent& extent);

/// What a file's comment states of the road: its source, and how the file's frame lies in that.
std::string described(const RoadToExport& road);

/// Where an export of that line looks for ground. @throws std::invalid_argument as SmoothLine.
PlanCorridor corridor_of(const std::vector<Eigen::Vector3d>& line, const RoadExtent& extent);

/// m that a smooth line may pass its points by: 5 times their scatter, at most 0.3 m, or `least`.
double line_tolerance(const std::vector<Eigen::Vector3d>& line, double least);

}  // namespace camber
