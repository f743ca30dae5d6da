#pragma once

#include <filesystem>
#include <optional>

#include "camber/cloud/cloud_io.h"
#include "camber/scene/georeference.h"

namespace camber::tools {

/// Where a result lies on the map: of the run.json beside one of its files; none where there is no
/// such file or it has no place. @throws InputError.
std::optional<GeoReference> georeference_beside(const std::filesystem::path& file);

/// A cloud of a run's reference camera, on the map: z-up, its origin a round place.
void take_to_map(const GeoReference& map, RoadCloud* cloud);

}  // namespace camber::tools
