#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/geometry/se3.h"
#include "camber/road/road_strip.h"

namespace camber::tools {

/// What `strip/index.json` of a drive says.
struct StripIndex {
  struct Stretch {
    std::filesystem::path file;
    double from_s = 0.0;  ///< m along the driven line
  };
  bool metric = true;
  std::string level;                  ///< "gravity" or "camera"
  SE3 strip_from_world;               ///< turns up to z
  double cell = 0.5;                  ///< m, along and across
  std::vector<Eigen::Vector3d> line;  ///< the driven one, strip frame
  std::vector<Stretch> stretches;     ///< in the order of the drive
};

/// Whether a path is the folder of a drive's strip.
bool is_strip(const std::filesystem::path& folder);

/// @throws InputError
StripIndex read_strip_index(const std::filesystem::path& folder);

/// The cells of all stretches, in order, with their standard deviations and labels.
/// @throws InputError
RoadCloud read_strip_cells(const StripIndex& index);

/// The whole strip as its drive left it, without colours and numbers of observations.
/// @throws InputError
RoadStrip read_strip(const StripIndex& index);

}  // namespace camber::tools
