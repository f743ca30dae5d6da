#include "config_file.h"

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <regex>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "nearest_name.h"
#include "options.h"
#include "verbs.h"

namespace camber::tools {
namespace {

constexpr std::uintmax_t kMaxBytes = 1 << 20;

std::string line_of(const toml::node& node) {
  return "line " + std::to_string(node.source().begin.line);
}

std::string text_of(const toml::node& node, const std::string& name, const std::string& path) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* whole = node.as_integer()) return std::to_string(whole->get());
  const auto* real = node.as_floating_point();
  if (real && std::isfinite(real->get())) return to_text(real->get());
  throw InputError(path, line_of(node),
                   name +
                       ": found a value of another kind, expected text, a number, true or "
                       "false, or an array of texts or numbers");
}

ConfigItem item_of(const std::string& key, const toml::node& node, const std::string& path) {
  ConfigItem item;
  item.key = key;
  std::replace(item.key.begin(), item.key.end(), '_', '-');
  item.line = static_cast<int>(node.source().begin.line);
  if (const auto* truth = node.as_boolean()) {
    item.truth = truth->get();
  } else if (const auto* list = node.as_array()) {
    for (const toml::node& value : *list) item.values.push_back(text_of(value, key, path));
    if (list->empty()) {
      throw InputError(path, line_of(node), key + ": found an empty array, expected a value");
    }
  } else {
    item.values.push_back(text_of(node, key, path));
  }
  return item;
}

void check_verbs(const toml::table& root, const std::string& path) {
  std::vector<std::string> verbs;
  for (const Verb& verb : kVerbs) verbs.emplace_back(verb.name);
  for (const auto& [key, node] : root) {
    const std::string name(key.str());
    if (!node.is_table() || std::find(verbs.begin(), verbs.end(), name) != verbs.end()) continue;
    const std::string meant = nearest_name(name, verbs);
    throw InputError(
        path, line_of(node),
        "there is no command " + name + (meant.empty() ? "" : ": did you mean [" + meant + "]?"));
  }
}

void take(const toml::table& table, const std::string& path, std::vector<ConfigItem>* items) {
  for (const auto& [key, node] : table) {
    if (node.is_table()) continue;
    ConfigItem item = item_of(std::string(key.str()), node, path);
    const auto same = std::find_if(items->begin(), items->end(),
                                   [&](const ConfigItem& other) { return other.key == item.key; });
    if (same == items->end()) {
      items->push_back(std::move(item));
    } else {
      *same = std::move(item);
    }
  }
}

}  // namespace

std::vector<ConfigItem> read_config(const std::filesystem::path& path,
                                    const std::vector<std::string>& command) {
  const std::string name = path.string();
  const std::string text = read_whole_file(path, kMaxBytes);
  toml::table root;
  try {
    root = toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    throw InputError(name, "line " + std::to_string(error.source().begin.line),
                     "found no TOML: " + std::string(error.description()));
  }
  check_verbs(root, name);
  std::vector<ConfigItem> items;
  take(root, name, &items);
  const toml::table* table = &root;
  for (const std::string& word : command) {
    const toml::node* below = table->get(word);
    table = below ? below->as_table() : nullptr;
    if (!table) return items;
  }
  take(*table, name, &items);
  return items;
}

std::string to_toml(const std::vector<std::string>& values, bool list) {
  static const std::regex number(R"([+-]?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?)");
  std::string out = list ? "[" : "";
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (i > 0) out += ", ";
    // TOML's whole numbers have 64 bits, with a sign.
    const bool whole = values[i].find_first_of(".eE") == std::string::npos;
    if (std::regex_match(values[i], number) && (!whole || values[i].size() < 19)) {
      out += values[i];
    } else {
      std::ostringstream quoted;
      quoted << toml::value<std::string>(values[i]);
      out += quoted.str();
    }
  }
  return out + (list ? "]" : "");
}

}  // namespace camber::tools
