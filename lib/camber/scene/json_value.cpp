#include "camber/scene/json_value.h"

#include <nlohmann/json.hpp>
#include <utility>

namespace camber {
namespace {

const nlohmann::json kNull;

}  // namespace

JsonValue::JsonValue() = default;
JsonValue::JsonValue(const nlohmann::json& json) : json_(std::make_unique<nlohmann::json>(json)) {}
JsonValue::JsonValue(const JsonValue& other)
    : json_(other.json_ ? std::make_unique<nlohmann::json>(*other.json_) : nullptr) {}
JsonValue::JsonValue(JsonValue&& other) noexcept = default;
JsonValue& JsonValue::operator=(JsonValue other) noexcept {
  std::swap(json_, other.json_);
  return *this;
}
JsonValue::~JsonValue() = default;

JsonValue JsonValue::object() { return nlohmann::json::object(); }

nlohmann::json& JsonValue::operator*() {
  if (!json_) json_ = std::make_unique<nlohmann::json>();
  return *json_;
}
const nlohmann::json& JsonValue::operator*() const { return json_ ? *json_ : kNull; }
nlohmann::json& JsonValue::operator[](const std::string& key) { return (**this)[key]; }
const nlohmann::json& JsonValue::operator[](const std::string& key) const {
  const auto found = (**this).find(key);
  return found == (**this).end() ? kNull : *found;
}

}  // namespace camber
