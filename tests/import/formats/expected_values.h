#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "support/test_data.h"

namespace camber::test {

/// ../shared/data/format-files/KIND/expected.json; an empty object where the data is not there.
inline nlohmann::json expected_values(const std::string& kind) {
  const std::string text = read_text(data_dir() / "format-files" / kind / "expected.json");
  return text.empty() ? nlohmann::json::object() : nlohmann::json::parse(text);
}

inline std::filesystem::path format_file(const std::string& kind, const std::string& name) {
  return data_dir() / "format-files" / kind / name;
}

}  // namespace camber::test
