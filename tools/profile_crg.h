#pragma once

#include <string>

#include "command.h"
#include "profile_output.h"

namespace camber::tools {

/// `camber profile FILE.crg`: heights of an OpenCRG road at given places.
struct CrgProfileArguments {
  std::string file, line;
  ProfileOutput output;
  bool as_stored = false;  ///< without the modifiers of the file
};

int profile_crg(const Command& command, const CrgProfileArguments& arguments);

}  // namespace camber::tools
