#pragma once

#include <filesystem>

#include "camber/road/road_surface.h"

namespace camber {

/// A surface without patches and links.
RoadSurface without_contents(const RoadSurface& surface);

/// Writes what format_json() makes of to_json(surface), atomically, with some patches and links as
/// JSON in memory at a time. @throws OutputError (path, reason)
void write_surface(const RoadSurface& surface, const std::filesystem::path& path);

}  // namespace camber
