#pragma once

#include <string>
#include <vector>

#include "camber/road/cloud_profile.h"
#include "cloud_arguments.h"
#include "command.h"
#include "line_input.h"
#include "road_arguments.h"

namespace camber::tools {

/// What profile has of a cloud alone, and how it is read.
struct CloudProfileArguments {
  std::string cloud, line, out, plot, sections;
  bool json = false;
  CloudArguments reading;
  UpArguments up;
  LineArguments along;
  CloudProfileOptions options;
  std::string ground_from = "auto";
};

/// Whether profile takes an input as a cloud: a file whose content or name is one's.
bool is_cloud(const std::string& path);

/// camber profile of a cloud along a line.
int profile_of_cloud(const Command& command, const CloudProfileArguments& args);

}  // namespace camber::tools
