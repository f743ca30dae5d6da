#include "camber/export/foxglove.h"

#include <cstdint>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace camber {
namespace {

using nlohmann::json;

json number() { return {{"type", "number"}}; }
json integer() { return {{"type", "integer"}}; }
json text() { return {{"type", "string"}}; }
json boolean() { return {{"type", "boolean"}}; }
json bytes() { return {{"type", "string"}, {"contentEncoding", "base64"}}; }
json list(const json& items) { return {{"type", "array"}, {"items", items}}; }
json numbers(int count) {
  return {{"type", "array"}, {"items", number()}, {"minItems", count}, {"maxItems", count}};
}
json object(const json& properties) { return {{"type", "object"}, {"properties", properties}}; }

json time_of_day() {
  return {{"type", "object"},
          {"title", "time"},
          {"properties", {{"sec", integer()}, {"nsec", integer()}}}};
}
json duration() {
  return {{"type", "object"},
          {"title", "duration"},
          {"properties", {{"sec", integer()}, {"nsec", integer()}}}};
}
json vector() { return object({{"x", number()}, {"y", number()}, {"z", number()}}); }
json quaternion() {
  return object({{"x", number()}, {"y", number()}, {"z", number()}, {"w", number()}});
}
json pose() { return object({{"position", vector()}, {"orientation", quaternion()}}); }
json color() {
  return object({{"r", number()}, {"g", number()}, {"b", number()}, {"a", number()}});
}

json properties_of(const std::string& name) {
  if (name == "foxglove.CompressedImage") {
    return {
        {"timestamp", time_of_day()}, {"frame_id", text()}, {"data", bytes()}, {"format", text()}};
  }
  if (name == "foxglove.CameraCalibration") {
    return {{"timestamp", time_of_day()},
            {"frame_id", text()},
            {"width", integer()},
            {"height", integer()},
            {"distortion_model", text()},
            {"D", list(number())},
            {"K", numbers(9)},
            {"R", numbers(9)},
            {"P", numbers(12)}};
  }
  if (name == "foxglove.FrameTransform") {
    return {{"timestamp", time_of_day()},
            {"parent_frame_id", text()},
            {"child_frame_id", text()},
            {"translation", vector()},
            {"rotation", quaternion()}};
  }
  if (name == "foxglove.PointCloud") {
    return {
        {"timestamp", time_of_day()},
        {"frame_id", text()},
        {"pose", pose()},
        {"point_stride", integer()},
        {"fields", list(object({{"name", text()}, {"offset", integer()}, {"type", integer()}}))},
        {"data", bytes()}};
  }
  if (name == "foxglove.LocationFix") {
    return {{"timestamp", time_of_day()},
            {"frame_id", text()},
            {"latitude", number()},
            {"longitude", number()},
            {"altitude", number()},
            {"position_covariance", numbers(9)},
            {"position_covariance_type", integer()}};
  }
  if (name == "foxglove.SceneUpdate") {
    const json line = object({{"type", integer()},
                              {"pose", pose()},
                              {"thickness", number()},
                              {"scale_invariant", boolean()},
                              {"points", list(vector())},
                              {"color", color()},
                              {"colors", list(color())},
                              {"indices", list(integer())}});
    const json cube = object({{"pose", pose()}, {"size", vector()}, {"color", color()}});
    const json label = object({{"pose", pose()},
                               {"billboard", boolean()},
                               {"font_size", number()},
                               {"scale_invariant", boolean()},
                               {"color", color()},
                               {"text", text()}});
    const json entity = object({{"timestamp", time_of_day()},
                                {"frame_id", text()},
                                {"id", text()},
                                {"lifetime", duration()},
                                {"frame_locked", boolean()},
                                {"metadata", list(object({{"key", text()}, {"value", text()}}))},
                                {"arrows", list(object(json::object()))},
                                {"cubes", list(cube)},
                                {"spheres", list(object(json::object()))},
                                {"cylinders", list(object(json::object()))},
                                {"lines", list(line)},
                                {"triangles", list(object(json::object()))},
                                {"texts", list(label)},
                                {"models", list(object(json::object()))}});
    return {{"deletions",
             list(object({{"timestamp", time_of_day()}, {"type", integer()}, {"id", text()}}))},
            {"entities", list(entity)}};
  }
  throw std::invalid_argument("schema: found '" + name + "', expected one of Foxglove's");
}

}  // namespace

std::string foxglove_schema(const std::string& name) {
  json out = object(properties_of(name));
  out["title"] = name;
  return out.dump();
}

std::string base64(std::string_view bytes) {
  static const char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (int k = 3; k >= 0; --k) out += kDigits[three >> (6 * k) & 63];
  }
  const std::size_t over = bytes.size() % 3;
  if (over > 0) out.replace(out.size() - (3 - over), 3 - over, 3 - over, '=');
  return out;
}

}  // namespace camber
