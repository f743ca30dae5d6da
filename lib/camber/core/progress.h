#pragma once

#include <functional>
#include <string>

namespace camber {

/// Called by long computations with the stage's name and the share done in [0, 1]. May throw
/// InterruptedError to stop the run. An empty function means that nothing is reported.
using Progress = std::function<void(const std::string& stage, double share)>;

/// Receives warnings of the library, one sentence each. The library itself never prints.
using LogSink = std::function<void(const std::string& sentence)>;

}  // namespace camber
