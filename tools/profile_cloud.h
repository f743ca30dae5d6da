#pragma once

#include <string>
#include <vector>

#include "camber/road/cloud_profile.h"
#include "cloud_arguments.h"
#include "command.h"
#include "line_input.h"
#include "profile_output.h"
#include "road_arguments.h"

namespace camber::tools {

/// What profile has of points alone, and how they are read.
struct CloudProfileArguments {
  std::string cloud, line, plot, sections;
  ProfileOutput output;
  CloudArguments reading;
  UpArguments up;
  LineArguments along;
  CloudProfileOptions options;
  std::string ground_from = "auto";
  bool as_stored = false;  ///< of an OpenCRG file: without its modifiers
};

/// Whether profile measures an input by cross-sections of its points: a cloud, a GeoTIFF of heights
/// or the strip of a drive.
bool is_cloud(const std::string& path);

/// camber profile of a cloud along a line; of a GeoTIFF's cells; of a strip's along the driven
/// line, where no other is given.
int profile_of_cloud(const Command& command, const CloudProfileArguments& args);

}  // namespace camber::tools
