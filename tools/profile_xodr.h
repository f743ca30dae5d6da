#pragma once

#include <string>

#include "command.h"
#include "profile_output.h"

namespace camber::tools {

/// What profile takes of an OpenDRIVE file.
struct XodrProfileArguments {
  std::string file, road;
  ProfileOutput output;
  double step = 1.0;  ///< m
};

/// camber profile of a road of an OpenDRIVE file: height, grade, superelevation and width along it.
int profile_xodr(const Command& command, const XodrProfileArguments& args);

}  // namespace camber::tools
