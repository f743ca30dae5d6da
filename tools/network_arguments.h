#pragma once

#include <string>

#include "camber/pipeline/network_choice.h"
#include "options.h"

namespace camber::tools {

/// The networks that a command runs on a scene's images, as typed.
struct NetworkArguments {
  NetworkChoice choice;
  std::string cache;
  bool no_cache = false;
};

void add_network_options(App& app, NetworkArguments& arguments);

/// @throws UsageError for a side file without its network.
NetworkChoice choice_of(const NetworkArguments& arguments);

}  // namespace camber::tools
