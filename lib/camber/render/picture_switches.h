#pragma once

#include <string>
#include <vector>

#include "camber/render/overlay.h"
#include "camber/render/pictures.h"

namespace camber {

/// A part of a picture: how it is called and the option behind it. Those of the 3D scene are
/// scene_switches().
template <typename Options>
struct PictureSwitch {
  const char* name;
  bool Options::*shown;
};

const std::vector<PictureSwitch<BevPictureOptions>>& bev_switches();
const std::vector<PictureSwitch<OverlayOptions>>& overlay_switches();

/// "grid, points, ...". @param table  of switches.
template <typename Table>
std::string names_of_parts(const Table& table) {
  std::string all;
  for (const auto& entry : table) all += (all.empty() ? "" : ", ") + std::string(entry.name);
  return all;
}

/// @throws std::invalid_argument "show: found 'x', which the view bev does not have; ...".
[[noreturn]] void refuse_part(const char* option, const std::string& name, const std::string& view,
                              const std::string& known);

/// Sets the switches of a table. @param view  for the message.
/// @throws std::invalid_argument for a name that the table does not have.
template <typename Table, typename Options>
void switch_parts(const Table& table, const std::vector<std::string>& show,
                  const std::vector<std::string>& hide, const std::string& view, Options* options) {
  const auto set = [&](const char* option, const std::vector<std::string>& names, bool value) {
    for (const std::string& name : names) {
      bool known = false;
      for (const auto& entry : table) {
        if (name != entry.name) continue;
        options->*entry.shown = value;
        known = true;
      }
      if (!known) refuse_part(option, name, view, names_of_parts(table));
    }
  };
  set("show", show, true);
  set("hide", hide, false);
}

}  // namespace camber
