#pragma once

#include <nlohmann/json_fwd.hpp>

#include "camber/core/stopwatch.h"
#include "export_inputs.h"

namespace camber::tools {

/// Writes a result of reconstruct as MCAP for Foxglove and other viewers: images, their
/// calibration, the cameras' poses, the road's points, patches and vehicles, and places on the
/// earth.
/// @return what was written, for --json. @throws NoAnswerError for a result without cameras.
nlohmann::json export_mcap(const CommonOptions& common, const ExportArguments& args,
                           Timings& timings);

}  // namespace camber::tools
