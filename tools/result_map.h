#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/export/trajectory.h"
#include "camber/scene/georeference.h"

namespace camber::tools {

/// Where a result lies on the map: of the run.json beside one of its files; none where there is no
/// such file or it has no place. @throws InputError.
std::optional<GeoReference> georeference_beside(const std::filesystem::path& file);

/// A cloud of a run's reference camera, on the map: z-up, its origin a round place.
void take_to_map(const GeoReference& map, RoadCloud* cloud);

/// Cameras on a map as points on the earth. Times only where they are in seconds and count from
/// 1970. @throws NoAnswerError where PROJ does not know the map.
std::vector<GeoPoint> track_on_earth(const std::vector<StampedPose>& poses, const std::string& crs,
                                     bool seconds);

}  // namespace camber::tools
