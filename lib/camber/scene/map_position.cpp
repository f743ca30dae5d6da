#include "camber/scene/detail/map_position.h"

#include <cmath>

namespace camber {

namespace {
constexpr double kRadians = 0.017453292519943295;  // of a degree
}  // namespace

MapPosition read_map_position(const JsonCursor& cursor) {
  JsonObject object(cursor, "an object {\"position\", \"sigma\"}");
  MapPosition out;
  const JsonCursor position = object.require("position", "3 numbers [east, north, height]");
  out.position = position.vector3("3 numbers [east, north, height]", true);
  if (!out.position.head<2>().allFinite()) position.fail("numbers for east and north");
  const char* metres = "a positive number of metres";
  if (auto v = object.find("sigma")) out.sigma = v->positive(metres);
  if (auto v = object.find("height_sigma")) out.height_sigma = v->positive(metres);
  if (auto v = object.find("heading_deg")) {
    out.heading = v->number("degrees from east, counterclockwise") * kRadians;
  }
  if (auto v = object.find("heading_sigma_deg")) {
    out.heading_sigma = v->positive("a positive number of degrees") * kRadians;
  }
  object.note_unknown_keys();
  return out;
}

nlohmann::json map_position_json(const MapPosition& position) {
  nlohmann::json out = {{"position", vector_json(position.position)},
                        {"sigma", number_json(position.sigma)},
                        {"height_sigma", number_json(position.height_sigma)}};
  if (position.heading) {
    out["heading_deg"] = number_json(*position.heading / kRadians);
    out["heading_sigma_deg"] = number_json(position.heading_sigma / kRadians);
  }
  return out;
}

void read_map(const JsonCursor& cursor, Scene* scene) {
  JsonObject object(cursor, "an object {\"crs\", \"antenna\"}");
  scene->map_crs = object.require("crs", "a projected coordinate system in metres").text();
  if (auto v = object.find("antenna")) scene->antenna = v->vector3();
  object.note_unknown_keys();
}

}  // namespace camber
