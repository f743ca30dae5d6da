#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "command.h"

namespace camber::tools {

/// "12 s", "3 min 05 s", "2 h 10 min". @param seconds  >= 0.
std::string duration_text(double seconds);

/// As make_progress(), with the frames a second and the time that is left, as far as what was done
/// since the call lets expect it.
/// @param done    frames that are done of the stage "windows"; empty: the other stages' shares are
///                those of all frames.
Progress drive_progress(const CommonOptions& options, std::size_t frames,
                        std::function<std::size_t()> done);

}  // namespace camber::tools
