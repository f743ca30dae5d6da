#pragma once

#include <nlohmann/json_fwd.hpp>

#include "camber/core/stopwatch.h"
#include "command.h"
#include "export_inputs.h"

namespace camber::tools {

/// Whether export is asked for the raster of a whole cloud.
bool is_site(const ExportArguments& args);

/// camber export CLOUD --to geotiff, without a line.
nlohmann::json export_site(const CommonOptions& common, const ExportArguments& args,
                           Timings& timings);

}  // namespace camber::tools
