#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace camber::tools {

/// An option of a configuration file.
struct ConfigItem {
  std::string key;                  ///< the option's name without its dashes
  std::vector<std::string> values;  ///< as they would be typed; of true and false none
  std::optional<bool> truth;        ///< of true and false
  int line = 0;
};

/// The options that a TOML file has for a command: those before its first table, then those of the
/// command's table, [reconstruct] or [import.video]. Of a key that is in both the table's counts.
/// @param command its words, from the verb on.
/// @throws InputError with the line, also where a table is named like no verb.
std::vector<ConfigItem> read_config(const std::filesystem::path& path,
                                    const std::vector<std::string>& command);

/// The value of an option, or its values, as TOML.
std::string to_toml(const std::vector<std::string>& values, bool list);

}  // namespace camber::tools
