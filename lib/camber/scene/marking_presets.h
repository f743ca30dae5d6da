#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/scale/lane_marking_detection.h"

namespace camber {

struct Scene;

/// The keys of Scene::markings_m: "dash_length", ..., in the order of the documentation.
const std::vector<std::string>& marking_size_names();
/// Published sizes of painted markings, m, keys as Scene::markings_m; nothing for another name.
/// Sources: docs/formats.md, "Presets of markings_m".
std::optional<std::map<std::string, double>> marking_preset(const std::string& name);
/// "de-autobahn", ..., in the order of the documentation.
std::vector<std::string> marking_preset_names();
/// The known sizes of a scene's markings (Scene::markings_m).
LaneMarkingSizes marking_sizes(const Scene& scene);

}  // namespace camber
