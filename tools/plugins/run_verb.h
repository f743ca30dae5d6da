#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../command.h"
#include "plugin.h"

namespace camber::tools {

/// What a plugin with commands does: parses the line, whose first word is one of its commands,
/// touching no file; then runs it. @return the program's exit code, its reason on stderr.
int run_verb(int argc, char** argv,
             const std::vector<std::pair<std::string, void (*)(App&)>>& verbs);

}  // namespace camber::tools

/// What a plugin with commands exports.
CAMBER_EXPORT int camber_run(int argc, char** argv);
