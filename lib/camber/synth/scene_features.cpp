#include "camber/synth/scene_features.h"

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace camber {
namespace {

template <typename Kind>
using Names = std::vector<std::pair<Kind, std::string_view>>;

const Names<AsphaltTexture>& names_of(AsphaltTexture) {
  static const Names<AsphaltTexture> names = {{AsphaltTexture::kVaried, "varied"},
                                              {AsphaltTexture::kSelfSimilar, "self_similar"},
                                              {AsphaltTexture::kRepeating, "repeating"}};
  return names;
}

const Names<Pavements>& names_of(Pavements) {
  static const Names<Pavements> names = {{Pavements::kNone, "none"},
                                         {Pavements::kLeft, "left"},
                                         {Pavements::kRight, "right"},
                                         {Pavements::kBoth, "both"}};
  return names;
}

const Names<Markings>& names_of(Markings) {
  static const Names<Markings> names = {
      {Markings::kNone, "none"}, {Markings::kCenterLine, "center_line"}, {Markings::kAll, "all"}};
  return names;
}

template <typename Kind>
std::string_view name_of(Kind kind) {
  for (const auto& [value, name] : names_of(Kind())) {
    if (value == kind) return name;
  }
  throw std::invalid_argument("scene features: unknown value");
}

template <typename Kind>
Kind named(const char* what, std::string_view word) {
  std::string known;
  for (const auto& [value, name] : names_of(Kind())) {
    if (name == word) return value;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  throw std::invalid_argument(
      fmt::format("{}: found \"{}\", expected one of {}", what, word, known));
}

template <typename Kind>
const std::vector<Kind>& all_of() {
  static const std::vector<Kind> all = [] {
    std::vector<Kind> kinds;
    for (const auto& entry : names_of(Kind())) kinds.push_back(entry.first);
    return kinds;
  }();
  return all;
}

void check_range(const char* name, double value, double low, double high, const char* unit) {
  if (!(value >= low && value <= high)) {
    throw std::invalid_argument(
        fmt::format("{}: found {}, expected {} to {}{}", name, value, low, high, unit));
  }
}

void check_range(const char* name, const std::optional<double>& value, double low, double high,
                 const char* unit) {
  if (value) check_range(name, *value, low, high, unit);
}

}  // namespace

std::string_view to_string(AsphaltTexture texture) { return name_of(texture); }
AsphaltTexture asphalt_texture_from_string(std::string_view word) {
  return named<AsphaltTexture>("asphalt", word);
}
const std::vector<AsphaltTexture>& all_asphalt_textures() { return all_of<AsphaltTexture>(); }

std::string_view to_string(Pavements pavements) { return name_of(pavements); }
Pavements pavements_from_string(std::string_view word) {
  return named<Pavements>("pavements", word);
}
const std::vector<Pavements>& all_pavements() { return all_of<Pavements>(); }

std::string_view to_string(Markings markings) { return name_of(markings); }
Markings markings_from_string(std::string_view word) { return named<Markings>("markings", word); }
const std::vector<Markings>& all_markings() { return all_of<Markings>(); }

void SceneFeatures::validate() const {
  check_range("corner.radius", corner.radius, 5.0, 20.0, " m");
  check_range("corner.yaw_rate", corner.yaw_rate, 0.2, 0.9, " rad/s");
  check_range("corner.phase", corner.phase, 0.0, 1.0, "");
  check_range("corner.angle", corner.angle, 1.04, 2.1, " rad");
  check_range("corner.arm_grade", corner.arm_grade, -0.2, 0.2, "");
  if (bend.radius != 0.0) check_range("bend.radius", bend.radius, 30.0, 1000.0, " m");
  if (bend.radius != 0.0 && corner.enabled) {
    throw std::invalid_argument(fmt::format(
        "bend.radius: found {} together with a corner, expected 0: streets that meet are straight",
        bend.radius));
  }
  if (corner.enabled &&
      (roadside.pavements == Pavements::kLeft || roadside.pavements == Pavements::kRight)) {
    throw std::invalid_argument(
        fmt::format("roadside.pavements: found {} together with a corner, expected both or none",
                    to_string(*roadside.pavements)));
  }
  check_range("lead_car.gap", lead_car.gap, 4.0, 60.0, " m");
  check_range("asphalt.contrast", asphalt.contrast, 0.01, 3.0, "");
  check_range("asphalt.wetness", asphalt.wetness, 0.0, 1.0, "");
  check_range("roadside.kerb_height", roadside.kerb_height, 0.0, 0.25, " m");
  check_range("roadside.edge_distance", roadside.edge_distance, 0.8, 5.0, " m");
  check_range("roadside.half_width", roadside.half_width, 2.0, 8.0, " m");
  check_range("roadside.verge_rise", roadside.verge_rise, -0.2, 0.25, " m");
  check_range("roadside.verge_rise_width", roadside.verge_rise_width, 0.1, 1.0, " m");
  check_range("mounting.pitch", mounting.pitch, -0.35, 0.35, " rad");
  check_range("mounting.yaw", mounting.yaw, -0.35, 0.35, " rad");
  check_range("mounting.roll", mounting.roll, -0.35, 0.35, " rad");
  check_range("mounting.ahead_of_axle", mounting.ahead_of_axle, 0.0, 4.0, " m");
  check_range("weather.cloudiness", weather.cloudiness, 0.0, 1.0, "");
  check_range("weather.sun_elevation", weather.sun_elevation, 0.1, 1.5, " rad");
  check_range("weather.haze_distance", weather.haze_distance, 100.0, 10000.0, " m");
}

}  // namespace camber
