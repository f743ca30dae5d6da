#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace camber {

/// A JSON value as a member of a struct, copied like one. The parser's own header takes seconds to
/// compile: only a source file that looks into the value has to include <nlohmann/json.hpp>.
class JsonValue {
 public:
  JsonValue();                            ///< null
  JsonValue(const nlohmann::json& json);  // NOLINT(google-explicit-constructor): is one
  JsonValue(const JsonValue& other);
  JsonValue(JsonValue&& other) noexcept;  ///< leaves null
  JsonValue& operator=(JsonValue other) noexcept;
  ~JsonValue();
  static JsonValue object();  ///< {}

  nlohmann::json& operator*();
  const nlohmann::json& operator*() const;
  nlohmann::json* operator->() { return &**this; }
  const nlohmann::json* operator->() const { return &**this; }
  /// The value of an object's key; null, and there from now on, for a new one.
  nlohmann::json& operator[](const std::string& key);
  /// The same; null where there is no such key.
  const nlohmann::json& operator[](const std::string& key) const;

 private:
  std::unique_ptr<nlohmann::json> json_;  // nullptr: null
};

}  // namespace camber
