#pragma once

#include "camber/scene/json_reader.h"
#include "camber/scene/scene.h"

namespace camber {

// A scene's and a frame's key "gnss".
MapPosition read_map_position(const JsonCursor& cursor);
nlohmann::json map_position_json(const MapPosition& position);
void read_map(const JsonCursor& cursor, Scene* scene);

}  // namespace camber
