#include "camber/scene/marking_presets.h"

#include "camber/scene/scene.h"

namespace camber {
namespace {

struct Preset {
  const char* name;
  std::map<std::string, double> sizes;
};

constexpr double kFoot = 0.3048, kInch = 0.0254;  // m

const std::vector<Preset>& presets() {
  static const std::vector<Preset> all = {
      {"de-autobahn", {{"dash_length", 6.0}, {"dash_gap", 12.0}, {"line_width", 0.15}}},
      {"de-landstrasse", {{"dash_length", 4.0}, {"dash_gap", 8.0}, {"line_width", 0.12}}},
      {"de-innerorts",
       {{"dash_length", 3.0},
        {"dash_gap", 6.0},
        {"line_width", 0.12},
        {"zebra_stripe_width", 0.5},
        {"zebra_gap", 0.5}}},
      {"at-autobahn", {{"dash_length", 6.0}, {"dash_gap", 12.0}, {"line_width", 0.15}}},
      {"fr-autoroute", {{"dash_length", 3.0}, {"dash_gap", 10.0}, {"line_width", 0.15}}},
      {"fr-route", {{"dash_length", 3.0}, {"dash_gap", 10.0}, {"line_width", 0.12}}},
      {"us-4in",
       {{"dash_length", 10 * kFoot}, {"dash_gap", 30 * kFoot}, {"line_width", 4 * kInch}}},
      {"us-6in",
       {{"dash_length", 10 * kFoot}, {"dash_gap", 30 * kFoot}, {"line_width", 6 * kInch}}}};
  return all;
}

}  // namespace

const std::vector<std::string>& marking_size_names() {
  static const std::vector<std::string> kNames = {
      "dash_length",         "dash_gap",  "line_width", "zebra_stripe_width", "zebra_gap",
      "zebra_stripe_length", "lane_width"};
  return kNames;
}

std::optional<std::map<std::string, double>> marking_preset(const std::string& name) {
  for (const Preset& preset : presets()) {
    if (name == preset.name) return preset.sizes;
  }
  return std::nullopt;
}

std::vector<std::string> marking_preset_names() {
  std::vector<std::string> out;
  for (const Preset& preset : presets()) out.emplace_back(preset.name);
  return out;
}

LaneMarkingSizes marking_sizes(const Scene& scene) {
  const auto size = [&](const char* name) {
    const auto found = scene.markings_m.find(name);
    return found == scene.markings_m.end() ? 0.0 : found->second;
  };
  return {size("dash_length"),        size("dash_gap"),  size("line_width"),
          size("zebra_stripe_width"), size("zebra_gap"), size("zebra_stripe_length"),
          size("lane_width")};
}

}  // namespace camber
