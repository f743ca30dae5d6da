#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "camber/export/crg_strip.h"
#include "camber/export/road_to_export.h"
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

using ExportInputs = RoadToExport;

/// Whether a name is that of a result, not of a cloud.
bool is_surface(const std::filesystem::path& path);

/// What `make` makes of the line. @throws NoAnswerError for a line that leads nowhere.
template <typename Make>
auto leading_somewhere(const ExportArguments& args, const Make& make) {
  try {
    return make();
  } catch (const std::invalid_argument&) {
    throw NoAnswerError((args.line.empty() ? args.input : args.line) +
                        ": the line does not leave its first point");
  }
}

/// @param settled  steps that the data give are filled in
/// @throws NoAnswerError for what is not in metres or has no line; UsageError, InputError.
ExportInputs load_export(const ExportArguments& args, const CommonOptions& common,
                         ExportArguments* settled);

/// Colours of the cloud that an input is or holds; nullptr where it has none.
std::unique_ptr<ColorSource> colors_of(const ExportArguments& args, const ExportInputs& in);

}  // namespace camber::tools
