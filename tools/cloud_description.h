#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "camber/cloud/cloud_summary.h"

namespace camber::tools {

/// One object of `camber info`: as JSON, and as lines for people.
struct Description {
  nlohmann::json object;
  std::string lines;

  void line(const std::string& name, const std::string& value);
};

Description describe_cloud(const std::string& path, const CloudSummary& summary);

/// Kind, name, codes, units, text and keys of a coordinate system.
nlohmann::json to_json(const CoordinateSystem& system);

}  // namespace camber::tools
