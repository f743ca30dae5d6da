#pragma once

#include <cstddef>
#include <string>

#include "command.h"

namespace camber::tools {

/// "12 s", "3 min 05 s", "2 h 10 min". @param seconds  >= 0.
std::string duration_text(double seconds);

/// As make_progress(), with the frames a second and the time that is left, as far as what was done
/// since the call lets expect it.
/// @param frames  of the drive: the shares of its stages are those of all frames.
Progress drive_progress(const CommonOptions& options, std::size_t frames);

}  // namespace camber::tools
