#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/coordinate_system.h"
#include "camber/core/progress.h"
#include "command.h"

namespace camber::tools {

/// How the file of --along is read.
struct LineArguments {
  std::string crs;        ///< --line-crs
  std::string alignment;  ///< --alignment: a name, or a number from 1
};

/// Adds --line-crs and --alignment. The reference must live as long as the app.
void add_line_arguments(App& app, LineArguments& arguments);

/// A line for a cloud, in metres and in the cloud's coordinates: of any cloud format (points in
/// order), GeoJSON, GeoPackage, Shapefile, DXF or LandXML. Where line and cloud state different
/// coordinate systems, places are transformed by PROJ; heights are not, and are NaN then.
/// @param cloud_system  of the cloud, as its file states it; none: not known
/// @throws InputError, UsageError, NoAnswerError; "file: ..." where the line is one of several.
std::vector<Eigen::Vector3d> read_along(const std::string& path, const LineArguments& arguments,
                                        const std::optional<CoordinateSystem>& cloud_system,
                                        const LogSink& warn);

}  // namespace camber::tools
