#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "camber/export/height_source.h"
#include "camber/export/crg_strip.h"
#include "road_arguments.h"

namespace camber::tools {

/// The command line of `camber export`.
struct ExportArguments {
  std::string input, line, out;
  std::string target, encoding = "text", slope = "line", banking = "line";
  CloudArguments reading;
  UpArguments up;
  CrgGridOptions grid;
  double ahead = 60.0;      ///< m
  double tolerance = 0.02;  ///< m
  bool tolerance_given = false;
  double reach = 0.5;  ///< m
  std::string crg;     ///< of OpenDRIVE: name of an OpenCRG file
  bool vehicles = false;
  std::string ground_from = "auto", hillshade;  ///< of a site's raster
  double fill_holes = 0.0;                      ///< m, of a site's raster
  bool confine = false;
  bool as_json = false;
};

/// What an input gives: the ground, and the line along which it is wanted, in the plan frame.
struct ExportInputs {
  PlanFrame frame;
  std::unique_ptr<HeightSource> ground;
  std::vector<Eigen::Vector3d> line;
  std::string line_frame;                              ///< in which the line was given
  std::vector<std::vector<Eigen::Vector3d>> outlines;  ///< m, plan frame, of the ground
  std::string level;          ///< "gravity" or "camera" of a result; "map" of a cloud that is z-up
  std::string described;      ///< for comments in files
  std::string geo_reference;  ///< code or text of the coordinate system; empty: not known
  std::vector<std::filesystem::path> files;
};

/// Whether a name is that of a result, not of a cloud.
bool is_surface(const std::filesystem::path& path);

/// What `make` makes of the line. @throws NoAnswerError for a line that leads nowhere.
SmoothLine smooth_line(const ExportArguments& args, const std::function<SmoothLine()>& make);

/// @param settled  steps that the data give are filled in
/// @throws NoAnswerError for what is not in metres or has no line; UsageError, InputError.
ExportInputs load_export(const ExportArguments& args, const CommonOptions& common,
                         ExportArguments* settled);

/// Colours of the cloud that an input is or holds; nullptr where it has none.
std::unique_ptr<ColorSource> colors_of(const ExportArguments& args, const ExportInputs& in);

}  // namespace camber::tools
